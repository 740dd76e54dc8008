"""Specifications: what a file may leave out, where its files are looked for, and designs that follow from it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import mirror_cad
import mirror_cad.spec.file
from tests.conftest import constant, spec_of

VERTICAL = '[vertical]\nlaw = "constant"\nradius_mm = 1250.0\n'


def test_only_the_two_laws_are_required(spec_file: Callable[[str], Path]) -> None:
    spec = mirror_cad.load_spec(spec_file('[horizontal]\nlaw = "constant"\nradius_mm = 900\n' + VERTICAL))
    assert spec.name == "spec"
    assert (spec.outline.width_mm, spec.outline.left_height_mm, spec.outline.right_height_mm) == (230.0, 270.0, 340.0)
    assert (spec.eye.distance_mm, spec.eye.aligned, spec.scene.distance_mm) == (762.0, "right", 8200.0)
    assert (spec.surface.position_tolerance_mm, spec.surface.curvature_tolerance_percent) == (1e-5, 0.01)
    assert spec.limits.curvature_percent is None


def test_part_names_the_mirror_and_changes_nothing_of_it() -> None:
    bare, named = (spec_of(constant(900.0), constant(900.0), **sections) for sections in (
        {}, {"part": {"number": "A 47/11", "revision": "C", "hand": "right", "title": "Main mirror, wide"}}))
    assert (bare.part.number, bare.part.revision, bare.part.hand, bare.part.title) == (None, None, "left", None)
    assert (named.part.number, named.part.hand) == ("A 47/11", "right")
    assert (mirror_cad.design(bare).surface.poles == mirror_cad.design(named).surface.poles).all()


@pytest.mark.parametrize(("part", "named"), [
    ({"number": ""}, "part.number"), ({"revision": "  "}, "part.revision"), ({"title": "two\nlines"}, "one line of 1 to 100"),
    ({"number": "x" * 49}, "one line of 1 to 48"), ({"hand": "rigth"}, "did you mean 'right'"), ({"number": 4711}, "be text"),
    ({"numbr": "x"}, "did you mean 'number'")])
def test_bad_part_is_refused_with_key_and_reason(part: dict[str, object], named: str) -> None:
    with pytest.raises(mirror_cad.SpecError, match=named):
        spec_of(constant(900.0), constant(900.0), part=part)


def test_limits_of_the_view_have_two_sides_of_which_one_may_be_free(spec_file: Callable[[str], Path]) -> None:
    limits = mirror_cad.load_spec(spec_file(
        '[horizontal]\nlaw = "constant"\nradius_mm = 900\n' + VERTICAL
        + "[limits]\nh_fov_deg = [44, inf]\nlane_straightness_percent = [-inf, 45.5]\n")).limits
    assert (limits.h_fov_deg, limits.v_fov_left_deg, limits.lane_straightness_percent) == (
        (44.0, np.inf), None, (-np.inf, 45.5))


@pytest.mark.parametrize(("ends", "named"), [
    ([45, 44], "must not be above"), ([45], "two numbers"), (45, "two numbers"), (["a", 1], "two numbers"),
    ([float("nan"), 1], "two numbers"), ([float("inf"), float("inf")], "two numbers"), ([True, 3], "two numbers"),
    ([0, 10**400], "two numbers")])
def test_bad_limits_are_refused_with_key_and_reason(ends: object, named: str) -> None:
    with pytest.raises(mirror_cad.SpecError, match=rf"limits.h_fov_deg = .*{named}"):
        spec_of(constant(900.0), constant(900.0), limits={"h_fov_deg": ends})


@pytest.mark.parametrize(("sections", "words"), [
    ({"part": {"number": "a\u202eb\x1b[31m"}}, 'part.number = "a\ufffdb\ufffd[31m"'),
    ({"glass": {"thick\u2028ness": 3.0}}, "glass.thick\ufffdness: unknown key"),
    ({"name": "\ud800"}, 'name = "\ufffd"'),
    ({"horizontal": {"law": "expression", "radius": "1250 +"}}, "cannot be read: invalid syntax; it may hold")])
def test_messages_hold_nothing_unseen_and_no_parsers_words(sections: dict[str, object], words: str) -> None:
    raw = {"name": "a", "horizontal": constant(900.0), "vertical": constant(900.0)}
    with pytest.raises(mirror_cad.SpecError) as caught:
        mirror_cad.spec.file.validate_spec(raw | sections)
    assert words in str(caught.value)
    str(caught.value).encode()
    assert "<unknown>" not in str(caught.value)


LAWS = {"horizontal": {"law": "constant", "radius_mm": 1250.0}, "vertical": {"law": "constant", "radius_mm": 1250.0}}


@pytest.mark.parametrize(("sections", "message"), [
    ({**LAWS, "eye": {"aligned": "top"}}, "eye.aligned = \"top\": must be one of 'right', 'centre' or 'left'"),
    ({**LAWS, "eye": {"aligned": "lft"}},
     "eye.aligned = \"lft\": must be one of 'right', 'centre' or 'left'; did you mean 'left'?"),
    ({**LAWS, "vertical": {"law": "?"}},
     "vertical.law = \"?\": must be one of constant, linear, power, zones, table, expression"),
    ({"surface": {"method": "vew"}, "target": {"projection": "perspective", "azimuth_deg": [-3.0, 3.0],
                                               "elevation_deg": [-3.0, 3.0]}},
     "surface.method = \"vew\": must be one of 'decoupled', 'faithful', 'sphere' or 'view'; did you mean 'view'?"),
    ({**LAWS, "rules": {"rule": "R46", "class": 5}}, "rules.class = 5: must be text"),
    ({**LAWS, "rules": {"rule": "R46", "class_name": "V"}}, "rules.class_name: unknown key; did you mean 'class'?")])
def test_a_wrong_choice_is_told_once_and_by_the_key_that_the_file_has(sections: dict[str, object], message: str) -> None:
    with pytest.raises(mirror_cad.SpecError) as caught:
        mirror_cad.spec.file.validate_spec(sections)
    assert caught.value.faults == [f"specification: {message}"]


def test_a_table_from_csv_beside_the_spec_is_the_law(tmp_path: Path, spec_file: Callable[[str], Path]) -> None:
    x = np.linspace(-115.0, 115.0, 24)
    kappa = 1e-3 + 4e-9 * (115.0 - x) ** 2
    rows = "\n".join(f"{a},{k}" for a, k in zip(x, kappa, strict=True))
    (tmp_path / "law.csv").write_text("x_mm,curvature_per_mm\n" + rows + "\n", encoding="utf-8-sig")
    mirror = mirror_cad.design(mirror_cad.load_spec(spec_file('[horizontal]\nlaw = "table"\nfile = "law.csv"\n' + VERTICAL)))
    at = np.linspace(-115, 115, 997)
    # A cubic spline reproduces a parabola: only the rounding of 1e-3 is left.
    assert np.abs(mirror.curvature.horizontal(at) - (1e-3 + 4e-9 * (115.0 - at) ** 2)).max() < 1e-15


@pytest.mark.parametrize(("text", "named"), [
    ("x_mm|radius_mm\n0|900\n", "must start with a line naming the columns"),
    ("x_mm,radius\n0,900\n", "must start with a line naming the columns"),
    ("x_mm,radius_mm\n0,900\n1,abc\n", "line 3"),
    ("", "nothing"),
])
def test_bad_csv_names_file_and_line(text: str, named: str, tmp_path: Path, spec_file: Callable[[str], Path]) -> None:
    (tmp_path / "law.csv").write_text(text)
    with pytest.raises(mirror_cad.SpecError, match=named):
        mirror_cad.load_spec(spec_file('[horizontal]\nlaw = "table"\nfile = "law.csv"\n' + VERTICAL))


def test_laws_of_one_curvature_written_in_six_ways_agree() -> None:
    ways = [
        constant(900.0),
        {"law": "linear", "right_mm": 900.0, "left_mm": 900.0},
        {"law": "power", "right_mm": 900.0, "left_mm": 900.0, "exponent": 2.0},
        {"law": "zones", "right_mm": 900.0, "left_mm": 900.0, "blend_from": 0.3},
        {"law": "table", "x_mm": [-115.0, 0.0, 115.0], "radius_mm": [900.0, 900.0, 900.0]},
        {"law": "expression", "radius": "900 + 0*t"},
    ]
    places = np.linspace(-110, 110, 7)
    heights = [mirror_cad.design(spec_of(way, constant(900.0))).surface.evaluate(places, places)[:, 2] for way in ways]
    for other in heights[1:]:
        assert np.abs(other - heights[0]).max() < 2e-5  # both within the position tolerance of the same surface


def test_laws_run_from_right_to_left_and_are_held_beyond_their_span() -> None:
    law = {"law": "linear", "right_mm": 1250.0, "left_mm": 400.0}
    mirror = mirror_cad.design(spec_of(law, constant(1250.0)))
    assert 1.0 / mirror.curvature.horizontal([114.999999, 0.0, -114.999999]) == pytest.approx([1250.0, 825.0, 400.0], rel=1e-6)
    narrow = mirror_cad.design(spec_of(law | {"span_mm": [-50.0, 50.0]}, constant(1250.0)))
    assert 1.0 / narrow.curvature.horizontal([100.0, 0.0, -100.0]) == pytest.approx([1250.0, 825.0, 400.0])
    assert narrow.fit.met


@pytest.mark.parametrize(("where", "x"), [("centre", 0.0), ("right", 115.0), ("left", -115.0), (40.0, 40.0)])
def test_profile_is_level_where_the_spec_says(where: str | float, x: float) -> None:
    law = {"law": "linear", "right_mm": 1250.0, "left_mm": 800.0, "level_at": where}
    mirror = mirror_cad.design(spec_of(law, constant(1250.0)))
    assert float(mirror.exact.profile.slope(np.array([x]))[0]) == pytest.approx(0.0, abs=1e-15)
    assert mirror.surface.evaluate(0.0, 0.0) == pytest.approx([0.0, 0.0, 0.0], abs=1e-5)


def test_outlines_from_dxf_and_svg_are_cut_as_drawn(tmp_path: Path, spec_file: Callable[[str], Path]) -> None:
    svg = '<svg xmlns="http://www.w3.org/2000/svg" width="200mm" height="160mm" viewBox="-100 -80 200 160">' \
          '<ellipse cx="5" cy="-10" rx="90" ry="60"/></svg>'
    (tmp_path / "outline.svg").write_text(svg)
    head = '[horizontal]\nlaw = "constant"\nradius_mm = inf\n[vertical]\nlaw = "constant"\nradius_mm = inf\n'
    mirror = mirror_cad.design(mirror_cad.load_spec(spec_file(head + '[outline]\nfile = "outline.svg"\n')))
    assert mirror.box == pytest.approx((-85.0, 95.0, -50.0, 70.0), abs=1e-9)  # y turned up, not recentred
    assert mirror.plate.area_mm2 == pytest.approx(np.pi * 90 * 60, rel=1e-6)
    assert mirror.plate.volume_mm3 == pytest.approx(3.0 * np.pi * 90 * 60, rel=1e-6)
    from mirror_cad.outline.files import write_dxf

    write_dxf(mirror.outline, tmp_path / "outline.dxf")
    again = mirror_cad.design(mirror_cad.load_spec(spec_file(head + '[outline]\nfile = "outline.dxf"\n')))
    assert again.plate.area_mm2 == pytest.approx(mirror.plate.area_mm2, rel=1e-9)


def test_a_surface_that_ends_before_the_blank_is_made_as_far_as_it_exists() -> None:
    mirror = mirror_cad.design(spec_of(constant(1250.0), constant(171.0)))
    assert mirror.surface.domain[3] < 171.0
    assert any("less than blank and margin ask for" in note for note in mirror.notes)


@pytest.mark.parametrize(("digits", "says"), [(400, r"horizontal\.radius_mm: a whole number of about 40\d digits"),
                                              (5000, "not TOML: a number with thousands of digits")])
def test_whole_numbers_beyond_any_float_are_named(digits: int, says: str, tmp_path: Path) -> None:
    path = tmp_path / "huge.toml"
    path.write_text(f'[horizontal]\nlaw = "constant"\nradius_mm = {"9" * digits}\n'
                    '[vertical]\nlaw = "constant"\nradius_mm = 1000\n')
    with pytest.raises(mirror_cad.SpecError, match=says):
        mirror_cad.spec.file.load_spec(path)
