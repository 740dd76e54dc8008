"""What is true of outlines read from SVG."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from svgpathtools import parse_path

from mirror_cad.errors import OutlineError
from mirror_cad.outline import Arc, Line, Spline
from mirror_cad.outline.files import read_outline
from tests.outline_helpers import distance_to, examples, svg

PX = 25.4 / 96.0
TRIANGLE = '<path d="M10 20 L110 20 L10 70 Z"/>'


@pytest.mark.parametrize(
    ("root", "scale"),
    [
        ("", (1, 1)),
        ('viewBox="-125 -190 250 380"', (1, 1)),
        ('width="250mm" height="380mm" viewBox="-125 -190 250 380"', (1, 1)),
        ('width="250" height="380" viewBox="-125 -190 250 380"', (1, 1)),
        ('width="100%" height="100%" viewBox="-125 -190 250 380"', (1, 1)),
        ('width="25cm" height="38cm" viewBox="0 0 500 760"', (0.5, 0.5)),
        ('width="10in" viewBox="0,0,127,5"', (2, 2)),
        ('height="10in" viewBox="0 0 5 127"', (2, 2)),
        ('width="960px" height="480px" viewBox="0 0 127 63.5"', (2, 2)),
        ('width="960px" height="480px"', (PX, PX)),
        ('width="72pt" height="6pc" viewBox="0 0 25.4 25.4"', (1, 1)),
        ('width="100mm" height="300mm" viewBox="0 0 100 100"', (1, 1)),
        ('width="100mm" height="300mm" viewBox="0 0 100 100" preserveAspectRatio="xMinYMax slice"', (3, 3)),
        ('width="100mm" height="300mm" viewBox="0 0 100 100" preserveAspectRatio="none"', (1, 3)),
    ],
)
def test_svg_size_and_view_box_give_the_scale_and_the_user_origin_is_the_mirrors(tmp_path, root, scale):
    outline = read_outline(svg(tmp_path, TRIANGLE, root))
    assert outline.bounding_box() == pytest.approx(
        (10 * scale[0], 110 * scale[0], -70 * scale[1], -20 * scale[1]), rel=1e-14
    )
    assert outline.area_mm2() == pytest.approx(2500 * scale[0] * scale[1])


@pytest.mark.parametrize(
    ("root", "said"),
    [
        ('width="500" height="760" viewBox="0 0 250 380"', 'write width="500mm"'),
        ('width="500mm" height="760" viewBox="0 0 250 380"', "both have a unit"),
        ('width="5em" viewBox="0 0 250 380"', "unit 'em' is not supported"),
        ('width="-5mm" viewBox="0 0 250 380"', "above 0"),
        ('width="wide" viewBox="0 0 250 380"', "not a length"),
        ('width="5mm" viewBox="0 0 250"', "viewBox"),
        ('width="5mm" viewBox="0 0 0 380"', "viewBox"),
        ('width="5mm" viewBox="0 0 5 5" preserveAspectRatio="middle"', "preserveAspectRatio"),
        ('width="5mm" viewBox="0 0 5 5" transform="scale(2)"', "transform"),
    ],
)
def test_an_svg_whose_scale_is_not_clear_is_an_error(tmp_path, root, said):
    with pytest.raises(OutlineError, match=said):
        read_outline(svg(tmp_path, TRIANGLE, root))


@pytest.mark.parametrize(
    ("transform", "box"),
    [
        ("translate(5)", (15, 115, -70, -20)),
        ("translate(5,-10)", (15, 115, -60, -10)),
        ("scale(2)", (20, 220, -140, -40)),
        ("scale(2 -1)", (20, 220, 20, 70)),
        ("rotate(90)", (-70, -20, -110, -10)),
        ("rotate(90 10 20)", (-40, 10, -120, -20)),
        ("matrix(0 1 -1 0 3 4)", (-67, -17, -114, -14)),
        ("skewX(45)", (30, 130, -70, -20)),
        ("skewY(45)", (10, 110, -130, -30)),
        (" translate(5 0) , scale(2)\n", (25, 225, -140, -40)),
        ("scale(2)translate(5 0)", (30, 230, -140, -40)),
    ],
)
def test_svg_transforms_apply_to_what_they_enclose(tmp_path, transform, box):
    on_path = svg(tmp_path, TRIANGLE.replace("/>", f' transform="{transform}"/>'))
    assert read_outline(on_path).bounding_box() == pytest.approx(box, abs=1e-12)
    on_group = svg(tmp_path, f'<g transform="scale(0.5)"><a><g transform="{transform}">{TRIANGLE}</g></a></g>')
    assert read_outline(on_group).bounding_box() == pytest.approx(np.array(box) / 2, abs=1e-12)


@pytest.mark.parametrize(
    ("body", "area", "kinds"),
    [
        ('<circle cx="5" cy="6" r="40"/>', 1600 * math.pi, {Arc}),
        ('<ellipse cx="5" cy="6" rx="40" ry="20"/>', 800 * math.pi, {Spline}),
        ('<ellipse rx="40"/>', 1600 * math.pi, {Arc}),
        ('<circle r="40" transform="rotate(30) scale(2 1)"/>', 3200 * math.pi, {Spline}),
        ('<circle r="40" transform="rotate(30) scale(2 -2)"/>', 6400 * math.pi, {Arc}),
        ('<rect x="5" y="6" width="80" height="40"/>', 3200, {Line}),
        ('<rect x="5" y="6" width="80" height="40" rx="10"/>', 3200 - 100 * (4 - math.pi), {Line, Arc}),
        ('<rect width="80" height="40" rx="10" ry="5"/>', 3200 - 50 * (4 - math.pi), {Line, Spline}),
        ('<rect width="80" height="40" rx="100"/>', 800 * math.pi, {Spline}),
        ('<rect width="80" height="40" ry="20"/>', 1600 + 400 * math.pi, {Line, Arc}),
        ('<polygon points="0,0 80,0,80-40"/>', 1600, {Line}),
        ('<polyline points="0,0 80,0 80,40 0 0"/>', 1600, {Line}),
        ('<line x2="80"/><line x1="80" x2="80" y2="40"/><polyline points="80 40 0 0"/>', 1600, {Line}),
        ('<path d="M0 0h80v40H0V0"/>', 3200, {Line}),
        ('<path d="m0 0 80 0 0 40-80 0z"/>', 3200, {Line}),
        ('<path d="M0,0A40,40,0,0,1,80,0A40 40 0 01 0 0Z"/>', 1600 * math.pi, {Arc}),
        ('<path d="M0 0a40 20 0 1080 0a40 20 0 10-80 0z"/>', 800 * math.pi, {Spline}),
        ('<path d="M0 0A1 1 0 0 0 80 0z"/>', 800 * math.pi, {Line, Arc}),
        ('<path d="M0 0A0 1 0 0 0 80 0L80 40z"/>', 1600, {Line}),
        ('<path d="M0 0Q40 60 80 0z"/>', 80 * 30 * 2 / 3, {Line, Spline}),
        ('<path d="M0 0C0 40 80 40 80 0z"/>', 80 * 30 * 0.8, {Line, Spline}),
        ('<path d="M0 0Q20 30 40 0T80 0L80 100L0 100z"/>', 8000, {Line, Spline}),
    ],
)
def test_every_svg_shape_has_its_area(tmp_path, body, area, kinds):
    outline = read_outline(svg(tmp_path, body))
    assert outline.area_mm2() == pytest.approx(area, rel=1e-12)
    assert {type(segment) for segment in outline.segments} == kinds


@given(st.data())
@examples
def test_svg_path_curves_agree_with_an_independent_reader(tmp_path, data):
    number = st.floats(-30, 30).map(lambda value: round(value, 3))

    def numbers(count):
        return " ".join(repr(data.draw(number)) for _ in range(count))

    # A fan of curves bulging outwards by little is simple whatever the numbers: each piece stays in its own sector.
    text, corner = "M 300 0", (300.0, 0.0)
    for i in range(1, 7):
        end = (300 * math.cos(i * math.pi / 3), 300 * math.sin(i * math.pi / 3)) if i < 6 else (300.0, 0.0)
        kind = data.draw(st.sampled_from("CcSsQqTtAaLlHhVv"))
        dx, dy = (end[0] - corner[0], end[1] - corner[1]) if kind.islower() else end
        third = [(corner[0] + (end[0] - corner[0]) * k / 3, corner[1] + (end[1] - corner[1]) * k / 3) for k in (1, 2)]
        inner = [(x + data.draw(number), y + data.draw(number)) for x, y in third]
        if kind.islower():
            inner = [(x - corner[0], y - corner[1]) for x, y in inner]
        first, second = (f"{x!r} {y!r}" for x, y in inner)
        upper = kind.upper()
        if upper == "C":
            text += f"{kind}{first},{second},{dx!r},{dy!r}"
        elif upper in "SQ":
            text += f"{kind}{second} {dx!r} {dy!r}"
        elif upper == "A":
            rx, ry = (data.draw(st.floats(200, 900)) for _ in range(2))
            text += f"{kind}{rx!r} {ry!r} {data.draw(number)!r} 0 {data.draw(st.integers(0, 1))} {dx!r} {dy!r}"
        else:
            text += f"L{end[0]!r} {end[1]!r}"
        corner = end
    try:
        outline = read_outline(svg(tmp_path, f'<path d="{text}Z"/>'))
    except OutlineError as error:
        assert "crosses" in str(error) or "folds" in str(error)
        assume(False)
    theirs = [piece.point(t) for piece in parse_path(text) for t in np.linspace(0, 1, 9)]
    points = np.column_stack([np.real(theirs), -np.imag(theirs)])
    assert distance_to(points, outline) < 2e-4


@pytest.mark.parametrize(
    ("body", "said"),
    [
        (TRIANGLE + '<circle r="3" cx="500" id="spot"/>', r"2 closed loops .*\(from <circle id='spot'>\)"),
        ('<path d="M0 0H50V50H0z m10 10h5v5h-5z"/>', "2 closed loops"),
        ('<path id="p" d="M0 0H50V50H0V1"/>', r"gap of 1 mm between \(0, .*0\) mm \(<path id='p'>\) and \(0, -1\) mm"),
        ('<path d="M0 0L50 50V0L0 30z"/>', "crosses"),
        ('<use href="#a"/>', "<use> uses '#a', and the file has no element of that id"),
        ('<image href="a.png"/>', "<image>"),
        ('<svg><circle r="5"/></svg>', "<svg>"),
        ('<g clip-path="url(#a)"><circle r="5"/></g>', "clip-path"),
        ('<circle r="5" style="transform: scale(2)"/>', "'transform' by CSS"),
        ('<style>circle{r:5}</style><circle r="9"/>', "'r' by CSS"),
        ('<circle r="50%"/>', "user units"),
        ('<circle r="5mm"/>', "user units"),
        ('<circle r="-5"/>', "negative"),
        ('<circle r="5" transform="scale(0)"/>', "flat"),
        ('<circle r="5" transform="spin(3)"/>', "transform spin"),
        ('<circle r="5" transform="scale(3"/>', "not understood"),
        ('<path d="L0 0"/>', "begins with 'L'"),
        ('<path d="M0 0L5 foo"/>', "'foo'"),
        ('<path d="M0 0L5"/>', "L has 1 numbers"),
        ('<path d="M0 0L5 6,"/>', "ends in ','"),
        ('<path d="M0 0A5 5 0 2 0 9 9"/>', "'2 0 9 9'"),
        ('<path d="M0 0H1e999"/>', "not a finite number"),
        ('<polygon points="0 0 1 1 2"/>', "an x without a y"),
        ("<text>outline</text><defs><circle r='9'/></defs>", "no outline found"),
        ('<g style="display:none">' + TRIANGLE + "</g>", "no outline found"),
    ],
)
def test_an_svg_that_is_not_one_closed_path_is_an_error_saying_why(tmp_path, body, said):
    with pytest.raises(OutlineError, match=said) as caught:
        read_outline(svg(tmp_path, body))
    assert "outline.svg" in str(caught.value)


def test_lengths_with_units_in_an_svg_of_physical_size_are_true(tmp_path):
    outline = read_outline(svg(tmp_path, '<circle r="5mm"/>', f'width="100mm" viewBox="0 0 {100 / PX} 9"'))
    assert outline.bounding_box() == pytest.approx((-5, 5, -5, 5), rel=1e-12)


def test_what_is_not_drawn_in_an_svg_is_ignored(tmp_path):
    body = (
        "<title>t</title><defs><circle r='5'/></defs><circle r='7' display='none'/><!-- c --><?pi?>"
        "<n:view xmlns:n='urn:n'><circle r='6'/></n:view><text>t</text><style>path{fill:none}</style>" + TRIANGLE
    )
    assert read_outline(svg(tmp_path, body)).area_mm2() == pytest.approx(2500)


def test_entities_in_a_document_type_are_refused_and_a_plain_one_is_not(tmp_path):
    laughs = "<!DOCTYPE svg [<!ENTITY a 'ha'><!ENTITY b '&a;&a;&a;'>]>"
    external = "<!DOCTYPE svg [<!ENTITY a SYSTEM 'file:///etc/hostname'>]>"
    parameter = "<!DOCTYPE svg [<!ENTITY % a SYSTEM 'http://localhost/'> %a;]>"
    for head in (laughs, external, parameter):
        with pytest.raises(OutlineError, match="declares the entity '[ab]'"):
            read_outline(svg(tmp_path, TRIANGLE, head=head))
    plain = '<!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 1.1//EN" "http://www.w3.org/Graphics/SVG/1.1/DTD/svg11.dtd">'
    assert read_outline(svg(tmp_path, TRIANGLE, head=plain)).area_mm2() == pytest.approx(2500)


def test_deeply_nested_groups_are_read(tmp_path):
    depth = 5000
    outline = read_outline(svg(tmp_path, "<g>" * depth + TRIANGLE + "</g>" * depth))
    assert outline.area_mm2() == pytest.approx(2500)
