"""Outline files as people have them: layers, blocks, gaps, damage, artboards; what counts of them is what is drawn."""

import math
import shutil
from pathlib import Path

import ezdxf
import numpy as np
import pytest
from ezdxf.math import Matrix44

from mirror_cad.design_stages import design
from mirror_cad.errors import OutlineError, SpecError
from mirror_cad.outline.files import FileOptions, open_outline, read_outline
from mirror_cad.spec.file import load_spec
from tests.outline_helpers import dxf, svg

CASES = Path(__file__).parent / "cases"


def square(space, x=0.0, y=0.0, size=100.0, **attributes):
    space.add_lwpolyline([(x, y), (x + size, y), (x + size, y + size), (x, y + size)], close=True, dxfattribs=attributes)


# --- the layers of a DXF file -----------------------------------------------------------------------------------------


def test_the_case_of_hidden_layers_is_a_circle_of_90_mm(tmp_path):
    folder = shutil.copytree(CASES / "dxf-hidden-layers", tmp_path / "case")
    found = open_outline(folder / "outline.dxf")
    assert found.outline.area_mm2() == pytest.approx(math.pi * 90**2, rel=1e-14)
    assert found.notes == ("outline.dxf: left out: 1 on the layer 'CENTRE', which is frozen",)
    mirror = design(load_spec(folder / "mirror.toml"))
    assert mirror.box == pytest.approx((-90, 90, -90, 90), abs=1e-12)
    assert found.notes[0] in mirror.notes
    spec = (folder / "mirror.toml").read_text()
    (folder / "mirror.toml").write_text(spec + 'layer = "centre"\n')
    with pytest.raises(OutlineError, match="outline is open"):  # asked for, a hidden layer counts: here a lone line
        design(load_spec(folder / "mirror.toml"))
    (folder / "mirror.toml").write_text(spec + 'layer = "Rim"\n')
    with pytest.raises(OutlineError, match="outline.layer = 'Rim': there is no such layer; the file has 0, CENTRE, Defpoints"):
        design(load_spec(folder / "mirror.toml"))


HIDDEN = {
    "off": lambda layer: layer.off(),
    "frozen": lambda layer: layer.freeze(),
    "never plotted": lambda layer: layer.dxf.set("plot", 0),
}


@pytest.mark.parametrize("why", HIDDEN)
def test_what_a_viewer_does_not_draw_is_no_outline_whatever_it_is(tmp_path, why):
    def draw(space):
        HIDDEN[why](space.doc.layers.add("Hidden"))
        square(space)
        for add in (lambda: square(space, 20, 20, 10, layer="hidden"), lambda: space.add_3dface([(0, 0), (9, 0), (9, 9)])):
            add()
        space[-1].dxf.layer = "HIDDEN"  # names of layers know no cases

    found = open_outline(dxf(tmp_path, draw))
    assert found.outline.area_mm2() == pytest.approx(1e4)
    assert found.notes == (f"outline.dxf: left out: 2 on the layer 'HIDDEN', which is {why}",) or \
        found.notes == (f"outline.dxf: left out: 1 on the layer 'HIDDEN', which is {why}; "
                        f"1 on the layer 'hidden', which is {why}",)


def test_invisible_entities_defpoints_endless_lines_and_fillings_are_left_out_and_said(tmp_path):
    def draw(space):
        square(space)
        square(space, 10, 10, 10, layer="Defpoints")
        square(space, 30, 30, 10, invisible=1)
        space.add_xline((0, 0), (1, 1))
        space.add_ray((0, 0), (1, 1))
        space.add_hatch().paths.add_polyline_path([(0, 0), (1, 0), (1, 1)])

    found = open_outline(dxf(tmp_path, draw))
    assert found.outline.area_mm2() == pytest.approx(1e4)
    (note,) = found.notes
    for part in ("1 invisible", "'Defpoints', which is never plotted", "1 HATCH", "1 XLINE", "1 RAY"):
        assert part in note


def test_a_drawing_of_hidden_layers_alone_has_no_outline_and_says_why(tmp_path):
    def draw(space):
        space.doc.layers.add("Rim").off()
        square(space, layer="Rim")

    path = dxf(tmp_path, draw)
    with pytest.raises(OutlineError, match="no outline found.*left out: 1 on the layer 'Rim', which is off"):
        read_outline(path)
    assert read_outline(path, FileOptions(layer="RIM")).area_mm2() == pytest.approx(1e4)


def test_a_layer_that_is_named_counts_alone(tmp_path):
    def draw(space):
        square(space, -50, -50)
        square(space, -80, -80, 160, layer="Blank")
        space.add_line((-200, 0), (200, 0), {"layer": "Axis"})

    path = dxf(tmp_path, draw)
    with pytest.raises(OutlineError, match=r"name its layer with outline\.layer"):
        read_outline(path)
    found = open_outline(path, FileOptions(layer="Blank"))
    assert found.outline.area_mm2() == pytest.approx(160**2)
    assert found.notes == ("outline.dxf: left out: 2 on other layers than 'Blank'",)


# --- blocks -----------------------------------------------------------------------------------------------------------


def test_a_block_is_drawn_where_it_stands_turned_scaled_and_stretched(tmp_path):
    place = Matrix44.chain(Matrix44.scale(2, 0.5, 1), Matrix44.z_rotate(math.radians(30)), Matrix44.translate(10, -20, 0))

    def draw(space):
        inner = space.doc.blocks.new("CORNER", base_point=(5, 0))
        inner.add_arc((5, 0), 50, 0, 180)
        outer = space.doc.blocks.new("RIM")
        outer.add_blockref("CORNER", (0, 0))
        outer.add_line((-50, 0), (50, 0))
        space.add_blockref("RIM", (10, -20), {"xscale": 2, "yscale": 0.5, "rotation": 30})

    outline = read_outline(dxf(tmp_path, draw))
    assert outline.area_mm2() == pytest.approx(math.pi * 50**2 / 2, rel=1e-9)  # 2 × 0.5 keeps the area of the half disc
    angle = np.linspace(0, math.pi, 2001)
    points = np.array([tuple(place.transform((50 * math.cos(a), 50 * math.sin(a), 0)))[:2] for a in angle])
    low, high = points.min(axis=0), points.max(axis=0)
    assert outline.bounding_box() == pytest.approx((low[0], high[0], low[1], high[1]), abs=1e-4)


def test_in_a_block_layer_0_is_that_of_the_insert_and_a_frozen_insert_hides_all_of_it(tmp_path):
    def draw(space, freeze):
        layer = space.doc.layers.add("Inserts")
        layer.freeze() if freeze else layer.off()
        block = space.doc.blocks.new("B")
        square(block, layer="Rim")
        square(block, 20, 20, 10)  # on 0: that of the insert, which is hidden
        space.add_blockref("B", (0, 0), {"layer": "Inserts"})

    found = open_outline(dxf(tmp_path, lambda space: draw(space, False)))
    assert found.outline.area_mm2() == pytest.approx(1e4)
    assert found.notes == ("outline.dxf: left out: 1 on the layer 'Inserts', which is off",)
    with pytest.raises(OutlineError, match="no outline found.*'Inserts', which is frozen"):
        read_outline(dxf(tmp_path, lambda space: draw(space, True)))
    read_outline(dxf(tmp_path, lambda space: draw(space, False)), FileOptions(layer="Rim"))


def endless(space):
    block = space.doc.blocks.new("B")
    block.add_blockref("B", (1, 1))
    space.add_blockref("B", (0, 0))


def crowd(space):
    for k in range(8):
        block = space.doc.blocks.new(f"B{k}")
        for _ in range(20):
            block.add_blockref(f"B{k + 1}", (0, 0)) if k < 7 else block.add_point((0, 0))
    space.add_blockref("B0", (0, 0))


def elsewhere(space):
    space.doc.blocks.new("B").block.dxf.update({"flags": 4, "xref_path": "rim.dwg"})
    space.add_blockref("B", (0, 0))


@pytest.mark.parametrize(("draw", "said"), [
    (lambda space: space.add_blockref("B", (0, 0)), "its block 'B' is missing"),
    (endless, "its block 'B' holds itself"),
    (crowd, "more than 2000 entities"),
    (elsewhere, r"stands for another file, 'rim\.dwg'; bind it"),
    (lambda space: [space.doc.blocks.new("B").add_line((0, 0), (9, 9)),
                    space.add_blockref("B", (0, 0), {
                        "row_count": 30000, "column_count": 30000, "row_spacing": 1, "column_spacing": 1})],
     "900000000 times"),
])
def test_a_block_that_cannot_be_drawn_is_an_error_saying_why(tmp_path, monkeypatch, draw, said):
    monkeypatch.setattr("mirror_cad.outline.dxf_drawn.MAXIMUM_ENTITIES", 2000)
    with pytest.raises(OutlineError, match=said):
        read_outline(dxf(tmp_path, draw))


# --- gaps and several loops -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("gap", [0.01, 0.05, 0.099])
def test_loose_ends_up_to_a_tenth_of_a_millimetre_apart_are_joined_and_said(tmp_path, gap):
    def draw(space):
        space.add_lwpolyline([(gap, 0), (100, 0), (100, 100)])
        space.add_lwpolyline([(100, 100 + gap), (0, 100), (0, 0)])

    found = open_outline(dxf(tmp_path, draw))
    assert found.outline.area_mm2() == pytest.approx(1e4, rel=2e-5 * gap / 0.01)
    (note,) = found.notes
    assert note.startswith(f"outline.dxf: 2 gaps of up to {gap:.3g} mm were closed (the widest at (")
    with pytest.raises(OutlineError, match=f"gap of {gap:g} mm .* gaps up to 0.001 mm are closed"):
        read_outline(tmp_path / "outline.dxf", FileOptions(join_mm=0.001))


def test_a_wider_gap_is_closed_where_asked_for_and_short_pieces_elsewhere_stay(tmp_path):
    fine = [(100 + 0.02 * k, 0.1 * k) for k in range(11)]  # pieces shorter than the gap

    def draw(space):
        space.add_lwpolyline([(0, 0), *fine, (100.2, 100), (0, 100), (0, 0.4)])

    path = dxf(tmp_path, draw)
    with pytest.raises(OutlineError, match="gap of 0.4 mm"):
        read_outline(path)
    outline = read_outline(path, FileOptions(join_mm=0.5))
    assert len(outline.segments) == 14
    with pytest.raises(OutlineError, match="join_mm is 2"):
        read_outline(path, FileOptions(join_mm=2.0))


def test_three_loose_ends_together_are_not_guessed_at(tmp_path):
    def draw(space):
        space.add_lwpolyline([(0, 0), (100, 0), (100, 100), (0, 100), (0, 0.05)])
        space.add_line((-0.03, 0.02), (-20, -20))

    with pytest.raises(OutlineError, match="open"):
        read_outline(dxf(tmp_path, draw))


def test_a_stray_line_shorter_than_the_gap_is_named_and_not_taken_for_a_loop(tmp_path):
    def draw(space):
        square(space)
        space.add_line((50, 50), (50.05, 50))

    with pytest.raises(OutlineError, match="1 closed loop and 1 leftover open piece"):
        read_outline(dxf(tmp_path, draw))


def test_the_outermost_loop_is_taken_on_request(tmp_path):
    def draw(space):
        square(space, -100, -100, 200)
        space.add_circle((0, 0), 30)
        space.add_line((-90, 0), (90, 0))

    path = dxf(tmp_path, draw)
    with pytest.raises(OutlineError, match='outline.loop = "outermost"'):
        read_outline(path)
    found = open_outline(path, FileOptions(loop="outermost"))
    assert found.outline.area_mm2() == pytest.approx(4e4)
    assert found.notes == ("outline.dxf: 2 closed loops and 1 leftover open piece found; the loop around all others is the "
                           "outline",)


@pytest.mark.parametrize("draw", [
    lambda space: [square(space), square(space, 200)],
    lambda space: [square(space), space.add_line((50, 50), (50, 150))],
    lambda space: [square(space), space.add_circle((50, 50), 60)],
    # Within the box of the round one, and beside it.
    lambda space: [space.add_circle((0, 0), 100), square(space, 85, 85, 10)],
])
def test_without_a_loop_around_all_others_there_is_no_outermost(tmp_path, draw):
    with pytest.raises(OutlineError, match="none of the loops is around all others"):
        read_outline(dxf(tmp_path, draw), FileOptions(loop="outermost"))


def test_the_keys_of_an_outline_file_belong_to_a_file(tmp_path):
    text = (CASES / "dxf-repairable" / "mirror.toml").read_text()
    path = tmp_path / "mirror.toml"
    for line, said in (('layer = "0"\njoin_mm = 0.05', "join_mm, layer say how an outline file is read: give file too"),
                       ('loop = "outer"', "loop"), ("join_mm = 3.0", "join_mm"), ("join_mm = 1e-5", "join_mm")):
        kept = text if "layer" not in line else text.replace('file = "empty-handles.dxf"', "")
        path.write_text(kept + line + "\n")
        with pytest.raises(SpecError, match=said):
            load_spec(path)


# --- damage -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["empty-handles", "comment-between-sections"])
def test_a_damaged_file_that_can_be_repaired_is_the_good_one_and_says_so(capfd, name):
    folder = CASES / "dxf-repairable"
    good, found = read_outline(folder / "good.dxf"), open_outline(folder / f"{name}.dxf")
    assert found.outline.area_mm2() == pytest.approx(120 * 80, rel=1e-14)
    assert found.outline.bounding_box() == good.bounding_box() == (0.0, 120.0, 0.0, 80.0)
    (note,) = found.notes
    assert note.startswith(f"{name}.dxf: the file is damaged (")
    assert "was repaired to be read" in note
    assert open_outline(folder / "good.dxf").notes == ()
    assert capfd.readouterr() == ("", "")  # the reading library's own log stays off the terminal


def test_a_file_that_was_cut_off_is_refused_wherever_that_was(tmp_path):
    """What is missing of it could have been a piece of the outline."""
    whole = ezdxf.new("R2000", units=4)
    for a, b in (((0, 0), (90, 0)), ((90, 0), (90, 60)), ((90, 60), (0, 60)), ((0, 60), (0, 0))):
        whole.modelspace().add_line(a, b)
    whole.saveas(tmp_path / "whole.dxf")
    text = (tmp_path / "whole.dxf").read_text()
    entities = text.index("\nENTITIES")
    end = text.index("ENDSEC", entities)
    for at in (entities, text.rindex("LINE", 0, end) - 4, end - 4):
        (tmp_path / "cut.dxf").write_text(text[:at])
        with pytest.raises(OutlineError, match="damaged DXF file|no outline found|open"):
            read_outline(tmp_path / "cut.dxf")


# --- SVG --------------------------------------------------------------------------------------------------------------

RIM = '<path id="rim" d="M-40 -60H40V60H-40Z"/>'
LINK = 'xmlns:xlink="http://www.w3.org/1999/xlink"'


@pytest.mark.parametrize("body", [
    f'<defs>{RIM}</defs><use href="#rim"/>',
    f'<defs>{RIM}</defs><use xlink:href="#rim"/>',
    '<defs><g id="half"><path id="rim" d="M0 -60H20V60H0Z" transform="scale(4 1)"/></g></defs>'
    '<g transform="translate(-60)"><use href="#half" x="20"/></g>',
    f'<symbol id="s">{RIM}</symbol><use href="#s" transform="rotate(180)"/>',
    f'<defs>{RIM}<use id="again" href="#rim" x="7"/></defs><use href="#again" x="-7"/>',
])
def test_what_a_use_draws_is_where_a_viewer_draws_it(tmp_path, body):
    assert read_outline(svg(tmp_path, body, LINK)).bounding_box() == pytest.approx((-40, 40, -60, 60), abs=1e-12)


def test_a_switch_draws_its_first_child_that_needs_no_extension(tmp_path):
    body = f'<switch><foreignObject requiredExtensions="http://ns.adobe.com/"/><g>{RIM}</g><circle r="9"/></switch>'
    assert read_outline(svg(tmp_path, body)).area_mm2() == pytest.approx(80 * 120)


ARTBOARDS = [
    # As Figma, Illustrator (a use, and by class), Inkscape and CorelDRAW write them.
    f'<g clip-path="url(#a)">{RIM}</g><defs><clipPath id="a"><rect x="-50" y="-70" width="100" height="140"/></clipPath>'
    '</defs>',
    '<defs><rect id="r" x="-40" y="-60" width="80" height="120"/></defs><clipPath id="a"><use xlink:href="#r"/></clipPath>'
    f'<g clip-path="url(#a)">{RIM}</g>',
    '<style>.st0{clip-path:url(#a);}.st1{fill:none}</style><defs><rect id="r" x="-50" y="-70" width="100" height="140"/>'
    f'</defs><clipPath id="a"><use xlink:href="#r"/></clipPath><g class="st1 st0">{RIM}</g>',
    '<clipPath id="a"><path d="M-50 70V-70H50V70Z" clip-rule="evenodd"/></clipPath>'
    f'<g style="clip-path:url(#a)" transform="rotate(90)"><g transform="rotate(-90)">{RIM.replace("60", "45")}</g></g>',
    f'<clipPath id="a"><polygon points="-5,-7 5,-7 5,7 -5,7" transform="scale(10)"/></clipPath>'
    f'<g clip-path="url(&quot;#a&quot;)">{RIM}</g>',
]


@pytest.mark.parametrize("body", ARTBOARDS)
def test_an_artboards_clip_path_cuts_nothing(tmp_path, body):
    assert read_outline(svg(tmp_path, body, LINK)).area_mm2() == pytest.approx(80 * (90 if "rotate" in body else 120))


@pytest.mark.parametrize(("body", "said"), [
    (f'<clipPath id="a"><rect x="-30" y="-70" width="100" height="140"/></clipPath><g clip-path="url(#a)">{RIM}</g>',
     "<path id='rim'> reaches beyond the clip-path of <g>, which would cut it"),
    (f'<clipPath id="a"><circle r="900"/></clipPath><g clip-path="url(#a)">{RIM}</g>', "no rectangle"),
    (f'<clipPath id="a" clipPathUnits="objectBoundingBox"><rect width="1" height="1"/></clipPath>'
     f'<g clip-path="url(#a)">{RIM}</g>', "no rectangle"),
    (f'<clipPath id="a"><path d="M-99-99H99V99Z"/></clipPath><g clip-path="url(#a)">{RIM}</g>', "no rectangle"),
    (f'<clipPath id="a"/><g clip-path="url(#a)">{RIM}</g>', "no rectangle"),
    (f'<g mask="url(#a)">{RIM}</g>', "mask"),
    ('<g id="a"><use href="#a"/></g>', "uses itself"),
    ('<use href="other.svg#a"/>', "not in this file"),
    (f'<symbol id="s" viewBox="0 0 9 9">{RIM}</symbol><use href="#s" width="3" height="3"/>', "scaled to a view"),
    ("".join(f'<g id="g{k}">' + f'<use href="#g{k + 1}"/>' * 30 + "</g>" for k in range(9)) + '<g id="g9"/>',
     "2000 elements"),
    (f'<g visibility="hidden">{RIM}</g>', "no outline found"),
])
def test_an_svg_whose_clips_or_uses_mean_something_else_is_an_error(tmp_path, monkeypatch, body, said):
    monkeypatch.setattr("mirror_cad.outline.svg.MAXIMUM_ELEMENTS", 2000)
    with pytest.raises(OutlineError, match=said):
        read_outline(svg(tmp_path, body, LINK))


def test_a_layer_of_an_svg_is_named_by_its_label_or_id(tmp_path):
    body = (f'<g inkscape:groupmode="layer" inkscape:label="Rim" id="layer1"><g>{RIM}</g></g>'
            '<g id="layer2" transform="translate(9)"><image/><circle r="9" clip-path="url(#none)"/></g>')
    path = svg(tmp_path, body, 'xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"')
    for layer in ("Rim", "layer1", "rim"):
        assert read_outline(path, FileOptions(layer=layer)).area_mm2() == pytest.approx(80 * 120)
    with pytest.raises(OutlineError, match="no element has that id or Inkscape label; the file has Rim, layer2, rim"):
        read_outline(path, FileOptions(layer="Blank"))
