"""What is true of outlines read from and written to DXF."""

import math
import random
import re
import time

import ezdxf
import numpy as np
import pytest
from ezdxf.math import OCS
from hypothesis import assume, given
from hypothesis import strategies as st

from mirror_cad.errors import OutlineError, WriteError
from mirror_cad.outline import Arc, Line, Spline, closed_outline, truck_outline
from mirror_cad.outline.files import read_outline, write_dxf
from tests.outline_helpers import SEGMENTS, WEIGHTS, assert_same_outline, dxf, examples, loop, trucks, wavy_spline


def square(space, size: float = 100.0, x: float = 0.0, y: float = 0.0, **attributes) -> None:
    corners = [(x, y), (x + size, y), (x + size, y + size), (x, y + size)]
    for i in range(4):
        space.add_line(corners[i], corners[(i + 1) % 4], attributes)


@given(trucks(), st.floats(-300, 300), st.floats(-300, 300))
@examples
def test_a_truck_outline_written_to_dxf_reads_back_the_same(tmp_path, truck, dx, dy):
    outline = truck_outline(*truck).moved(dx, dy)
    assume(all(math.dist(segment.start, segment.end) > 0.01 for segment in outline.segments))
    write_dxf(outline, tmp_path / "o.dxf")
    assert_same_outline(outline, read_outline(tmp_path / "o.dxf"))


@pytest.mark.parametrize("segment", [Arc((3, 4), 50, 0, 2 * math.pi), *SEGMENTS[3:]], ids=lambda s: type(s).__name__)
def test_a_closed_segment_written_to_dxf_reads_back_the_same(tmp_path, segment):
    outline = closed_outline([segment], "test")
    write_dxf(outline, tmp_path / "o.dxf")
    assert_same_outline(outline, read_outline(tmp_path / "o.dxf"))


def test_a_clockwise_arc_in_an_outline_reads_back_clockwise(tmp_path):
    bitten = loop([(0, 0), (100, 0), (100, 100), (0, 100)])
    bitten[1:2] = [
        Line((100, 0), (100, 20)),
        Arc((100, 50), 30, 1.5 * math.pi, -math.pi),
        Line((100, 80), (100, 100)),
    ]
    outline = closed_outline(bitten, "test")
    assert outline.area_mm2() == pytest.approx(1e4 - 450 * math.pi, rel=1e-14)
    write_dxf(outline, tmp_path / "o.dxf")
    assert_same_outline(outline, read_outline(tmp_path / "o.dxf"))


def test_the_written_dxf_is_r2010_in_mm_on_the_layer_outline(tmp_path):
    write_dxf(truck_outline(250, 400, 360, 30), tmp_path / "o.dxf")
    document = ezdxf.readfile(tmp_path / "o.dxf")
    assert (document.dxfversion, document.header["$INSUNITS"]) == ("AC1024", 4)
    assert {entity.dxf.layer for entity in document.modelspace()} == {"OUTLINE"}
    assert not document.audit().has_errors


def test_two_writes_are_byte_identical_when_source_date_epoch_is_set(tmp_path, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    outline = closed_outline([wavy_spline(WEIGHTS)], "test")
    write_dxf(outline, tmp_path / "a.dxf")
    time.sleep(0.01)
    write_dxf(outline, tmp_path / "b.dxf")
    assert (tmp_path / "a.dxf").read_bytes() == (tmp_path / "b.dxf").read_bytes()
    assert ezdxf.options.write_fixed_meta_data_for_testing is False


def test_a_dxf_that_cannot_be_written_or_would_lose_a_segment_is_an_error(tmp_path):
    with pytest.raises(WriteError, match="cannot be written"):
        write_dxf(truck_outline(250, 400, 360, 30), tmp_path / "missing" / "o.dxf")
    tiny = closed_outline(loop([(0, 0), (100, 0), (100, 100), (100 - 5e-4, 100), (0, 100)]), "test")
    with pytest.raises(OutlineError, match="segment 3 at .* not longer than 0.001 mm"):
        write_dxf(tiny, tmp_path / "o.dxf")


@pytest.mark.parametrize(
    ("unit", "mm"), [(0, 1), (1, 25.4), (2, 304.8), (4, 1), (5, 10), (6, 1000), (9, 0.0254), (10, 914.4), (14, 100)]
)
def test_dxf_units_are_converted_to_mm(tmp_path, unit, mm):
    size = 200 / mm

    def draw(space):
        space.add_line((0, 0), (size, 0))
        space.add_arc((size, size / 2), size / 2, -90, 90)
        space.add_spline(degree=1).set_open_uniform([(size, size), (0, size)], degree=1)
        space.add_lwpolyline([(0, size, 0, 0, 1), (0, 0)])

    outline = read_outline(dxf(tmp_path, draw, units=unit))
    assert outline.bounding_box() == pytest.approx((-100, 300, 0, 200), abs=1e-9)
    assert outline.area_mm2() == pytest.approx(200 * 200 + math.pi * 100**2, rel=1e-12)


def test_an_unknown_dxf_unit_is_an_error_naming_the_code(tmp_path):
    for code in (18, 99):
        path = dxf(tmp_path, square)
        path.write_text(re.sub(r"(\$INSUNITS\s+70\s+)4\b", rf"\g<1>{code}", path.read_text()))
        with pytest.raises(OutlineError, match=rf"\$INSUNITS = {code}"):
            read_outline(path)


def test_a_dxf_without_a_header_is_read_in_mm(tmp_path):
    corners = [(0, 0), (100, 0), (100, 50), (0, 50)]
    lines = "".join(
        f"0\nLINE\n8\n0\n10\n{x0}\n20\n{y0}\n11\n{x1}\n21\n{y1}\n"
        for (x0, y0), (x1, y1) in zip(corners, corners[1:] + corners[:1], strict=True)
    )
    path = tmp_path / "bare.dxf"
    path.write_text(f"0\nSECTION\n2\nENTITIES\n{lines}0\nENDSEC\n0\nEOF\n")
    assert read_outline(path).bounding_box() == (0, 100, 0, 50)


@given(st.randoms(use_true_random=False), trucks())
@examples
def test_dxf_pieces_are_chained_in_any_order_and_direction(tmp_path, shuffler: random.Random, truck):
    outline = truck_outline(*truck)
    assume(all(math.dist(segment.start, segment.end) > 0.01 for segment in outline.segments))
    pieces = list(outline.segments)
    shuffler.shuffle(pieces)

    def draw(space):
        for piece in pieces:
            # Half the allowed gap, to both sides.
            noise = [shuffler.uniform(-2e-4, 2e-4) for _ in range(4)]
            if isinstance(piece, Arc):
                turn = np.degrees([piece.start_angle, piece.start_angle + piece.sweep])
                space.add_arc(piece.centre, piece.radius_mm, *turn)
            else:
                ends = [np.add(piece.start, noise[:2]), np.add(piece.end, noise[2:])]
                shuffler.shuffle(ends)
                space.add_line(*ends)

    again = read_outline(dxf(tmp_path, draw))
    assert again.area_mm2() == pytest.approx(outline.area_mm2(), abs=1e-3 * sum(truck))
    for one, other in zip(again.segments, again.segments[1:] + again.segments[:1], strict=True):
        assert math.dist(one.end, other.start) < 1e-9


def test_a_dxf_ellipse_is_an_exact_rational_spline(tmp_path):
    outline = read_outline(dxf(tmp_path, lambda space: space.add_ellipse((10, 20), (30, 40), 0.5)))
    assert [type(segment) for segment in outline.segments] == [Spline]
    assert outline.area_mm2() == pytest.approx(math.pi * 50 * 25, rel=1e-13)
    x, y = (outline.segments[0].point(np.linspace(0, 1, 500)) - [10, 20]).T
    u, v = (0.6 * x + 0.8 * y) / 50, (0.6 * y - 0.8 * x) / 25
    np.testing.assert_allclose(u**2 + v**2, 1, atol=1e-13)
    half_width, half_height = math.hypot(30, 20), math.hypot(40, 15)
    assert outline.bounding_box() == pytest.approx(
        (10 - half_width, 10 + half_width, 20 - half_height, 20 + half_height), abs=1e-12
    )


def test_a_dxf_ellipse_of_ratio_one_is_an_arc_and_half_an_ellipse_closes_with_a_line(tmp_path):
    outline = read_outline(dxf(tmp_path, lambda space: space.add_ellipse((0, 0), (0, 40), 1)))
    assert [type(segment) for segment in outline.segments] == [Arc]

    def draw(space):
        space.add_ellipse((0, 0), (50, 0), 0.4, 0, math.pi)
        space.add_line((-50, 0), (50, 0))

    half = read_outline(dxf(tmp_path, draw))
    assert half.area_mm2() == pytest.approx(math.pi * 50 * 20 / 2, rel=1e-13)
    assert half.bounding_box() == pytest.approx((-50, 50, 0, 20), abs=1e-12)


@pytest.mark.parametrize("old", [False, True], ids=["LWPOLYLINE", "POLYLINE"])
def test_polyline_bulges_are_arcs(tmp_path, old):
    # A bulge of 1 is half a circle, of -1 one that bites into the square, of tan(pi/8) a quarter circle.
    points = [(0, 0, 1), (100, 0, 0), (100, 100, -1), (0, 100, math.tan(math.pi / 8))]

    def draw(space):
        if old:
            space.add_polyline2d(points, format="xyb", close=True)
        else:
            space.add_lwpolyline([*points, points[-1]], format="xyb", close=True)

    outline = read_outline(dxf(tmp_path, draw))
    radius = 100 / math.sqrt(2)
    assert outline.area_mm2() == pytest.approx(1e4 + radius**2 / 2 * (math.pi / 2 - 1), rel=1e-13)
    assert outline.bounding_box() == pytest.approx((50 - radius, 100, -50, 100), abs=1e-12)
    assert sorted(type(segment).__name__ for segment in outline.segments) == ["Arc", "Arc", "Arc", "Line"]


def test_a_flat_3d_polyline_is_an_outline_and_a_hilly_one_is_not(tmp_path):
    corners = [(0, 0, 5), (100, 0, 5), (50, 80, 5)]
    outline = read_outline(dxf(tmp_path, lambda space: space.add_polyline3d(corners, close=True)))
    assert outline.area_mm2() == pytest.approx(4000)
    with pytest.raises(OutlineError, match=r"z = 5 mm .* but 6 mm at POLYLINE with handle"):
        read_outline(dxf(tmp_path, lambda space: space.add_polyline3d([*corners[:2], (50, 80, 6)], close=True)))


@pytest.mark.parametrize("rational", [False, True])
def test_an_unclamped_dxf_spline_becomes_the_clamped_one_of_the_same_curve(tmp_path, rational):
    angle = np.arange(11) * 2 * math.pi / 8
    poles = np.column_stack([90 * np.cos(angle), 60 * np.sin(angle), np.full(11, 3.0)])
    weights = np.array([1, 2, 1, 0.5, 1, 3, 1, 1, 1, 2, 1]) if rational else np.ones(11)
    knots = np.arange(15.0)

    def draw(space):
        spline = space.add_spline(degree=3)
        spline.control_points, spline.knots = poles, knots
        if rational:
            spline.weights = weights

    outline = read_outline(dxf(tmp_path, draw))
    t = np.linspace(3, 11, 200)
    # De Boor's algorithm in homogeneous coordinates, on its own.
    expected = []
    for u in t:
        k = min(int(u), 10)
        d = [np.append(poles[j, :2] * weights[j], weights[j]) for j in range(k - 3, k + 1)]
        for r in range(1, 4):
            for j in range(3, r - 1, -1):
                a = (u - knots[j + k - 3]) / (knots[j + 1 + k - r] - knots[j + k - 3])
                d[j] = (1 - a) * d[j - 1] + a * d[j]
        expected.append(d[3][:2] / d[3][2])
    np.testing.assert_allclose(outline.segments[0].point((t - 3) / 8), expected, atol=1e-11)


def test_dxf_entities_seen_from_below_are_mirrored(tmp_path):
    below = {"extrusion": (0, 0, -1)}

    def draw(space):
        space.add_arc((-100, 50, -7), 50, 90, 270, dxfattribs=below)
        space.add_lwpolyline(
            [(-100, 0, 0), (0, 0, -1), (0, 100, 0), (-100, 100, 0)], "xyb", dxfattribs={**below, "elevation": -7}
        )

    ocs = OCS((0, 0, -1))
    assert ocs.to_wcs((-100, 50, -7)) == (100, 50, 7)
    outline = read_outline(dxf(tmp_path, draw))
    # The arc bulges to the right of x = 100, the polyline's to the left of x = 0 or into the square as OCS has it.
    arcs = [segment for segment in outline.segments if isinstance(segment, Arc)]
    assert outline.bounding_box() == pytest.approx((0, 150, 0, 100), abs=1e-12)
    assert sorted(np.sign(arc.sweep) for arc in arcs) == [-1, 1]
    assert outline.area_mm2() == pytest.approx(1e4, rel=1e-13)

    def draw_half(space):
        space.add_ellipse((0, 0), (50, 0), 0.4, 0, math.pi, dxfattribs=below)
        space.add_line((-50, 0), (50, 0))

    # Of an ellipse the extrusion turns only the sense of its angle.
    assert read_outline(dxf(tmp_path, draw_half)).bounding_box() == pytest.approx((-50, 50, -20, 0), abs=1e-12)


def test_entities_seen_from_below_agree_with_the_points_of_the_reading_library(tmp_path):
    def draw(space):
        space.add_arc((-20, 5), 40, 30, 250, dxfattribs={"extrusion": (0, 0, -1)})
        arc = space[0]
        space.add_line(arc.start_point, arc.end_point)

    outline = read_outline(dxf(tmp_path, draw))
    sector, triangle = 40**2 / 2 * math.radians(220), 40**2 / 2 * math.sin(math.radians(220))
    assert outline.area_mm2() == pytest.approx(sector - triangle, rel=1e-12)


def test_knots_that_differ_by_rounding_only_are_one_knot(tmp_path):
    spline = wavy_spline()
    knots = spline.knots + 1e-14 * np.arange(len(spline.knots))

    def draw(space):
        entity = space.add_spline(degree=3)
        entity.control_points, entity.knots = np.pad(spline.poles, ((0, 0), (0, 1))), knots

    outline = read_outline(dxf(tmp_path, draw))
    assert len(np.unique(outline.segments[0].knots)) == len(np.unique(spline.knots))
    s = np.linspace(0, 1, 50)
    np.testing.assert_allclose(outline.segments[0].point(s), spline.point(s), atol=1e-9)


def test_annotations_are_ignored(tmp_path):
    def draw(space):
        square(space)
        space.add_text("mirror")
        space.add_mtext("mirror")
        space.add_point((50, 50))
        space.add_linear_dim(base=(0, -20), p1=(0, 0), p2=(100, 0)).render()

    assert read_outline(dxf(tmp_path, draw)).area_mm2() == pytest.approx(1e4)


def test_pieces_without_length_are_dropped(tmp_path):
    def draw(space):
        square(space)
        space.add_line((100, 0), (100, 0))
        space.add_line((100, 100), (100, 100 + 5e-4))
        space.add_circle((0, 0), 1e-4)

    assert len(read_outline(dxf(tmp_path, draw)).segments) == 4


def spline_with_fit_points(space):
    space.add_spline([(0, 0), (10, 10), (20, 0)])


@pytest.mark.parametrize(
    ("draw", "said"),
    [
        (spline_with_fit_points, "SPLINE with handle .* no poles"),
        (lambda space: space.add_3dface([(0, 0), (9, 0), (9, 9)]), "3DFACE with handle .* not supported"),
        (lambda space: space.add_polyface(), "POLYLINE with handle .* meshes"),
        (lambda space: space.add_circle((0, 0), 50, {"extrusion": (0, 1, 1)}), r"CIRCLE .* \(0, 1, 1\)"),
        (lambda space: space.add_ellipse((0, 0), (50, 0, 10), 0.5), "not in one plane"),
        (lambda space: None, "no outline found"),
        (lambda space: space.add_text("only"), "no outline found"),
        (lambda space: space.add_line((0, 0), (1e-4, 0)), "check the units"),
        (lambda space: [square(space), square(space, x=200)], r"2 closed loops and 0 leftover .*x 200 to 300"),
        (lambda space: [square(space), space.add_circle((50, 50), 10)], r"2 closed loops .*x 40 to 60 and y 40 to 60"),
        (lambda space: [square(space), space.add_line((20, 20), (30, 30))],
         r"1 closed loop and 1 leftover open piece found.*x 20 to 30"),
        (lambda space: [square(space), square(space)], r"4 pieces end at .*: LINE with handle .* duplicates"),
        (lambda space: [square(space), space.add_line((0, 0), (-5, -5))], r"3 pieces end at \(0, 0\)"),
        (lambda space: space.add_lwpolyline([(0, 0), (100, 0), (100, 100), (0, 100), (0, 0.25)]),
         r"gap of 0.25 mm between \(0, 0\) mm .* and \(0, 0.25\) mm"),
        (lambda space: [space.add_lwpolyline([(0, 0), (100, 0), (100, 100)]),
                        space.add_lwpolyline([(100, 103), (0, 100), (0, 0.5)])],
         r"gap of 0.5 mm between \(0, 0\) .*; gap of 3 mm between \(100, 100\)"),
        (lambda space: space.add_lwpolyline([(0, 0), (100, 100), (100, 0), (0, 60)], close=True), "crosses"),
        (lambda space: [space.add_line((0, 0), (math.cos(i), math.sin(i))) for i in range(50)], "50 pieces end at"),
        (lambda space: [square(space), space[0].dxf.set("start", (0, 0, 3))], "one plane"),
        (lambda space: square(space, size=0.5), "0.5 mm wide"),
    ],
)  # fmt: skip
def test_a_dxf_that_is_not_one_plane_closed_loop_is_an_error_saying_why(tmp_path, draw, said):
    with pytest.raises(OutlineError, match=said) as caught:
        read_outline(dxf(tmp_path, draw))
    assert "outline.dxf" in str(caught.value)
