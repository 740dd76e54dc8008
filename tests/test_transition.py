"""The line where an aspheric part begins: on the outline, in STEP and DXF, and what rules ask on either side of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirror_cad.design_stages import design
from mirror_cad.errors import SpecError
from mirror_cad.mirror import Mirror
from mirror_cad.outline import truck_outline
from mirror_cad.outline.files import open_outline, write_dxf
from mirror_cad.outline.transition import transition_line
from mirror_cad.own_files import hand_of, transition_of
from mirror_cad.spec.file import load_spec, spec_as_json, validate_spec
from mirror_cad.surfaces.quadric import Quadric
from mirror_studio.rules.measuring import RuleQuantities, StatedProperties
from mirror_studio.rules.run import RuleRequest, measured_mirror
from mirror_studio.rules.schema import load_rule
from mirror_studio.rules.verdicts import judged
from raytrace.errors import TraceError
from raytrace.reflector import Reflector
from raytrace.surfaces.bspline import BSplineFace
from raytrace.surfaces.cut import inboard_of, outboard_of
from raytrace.surfaces.quadric import QuadricFace
from tests.rule_mirrors import TOWARDS_Z, sphere
from tests.test_spherometer import line

X_MM = -23.0


def aspheric(hand: str = "left", transition_mm: float = X_MM, **rules: object) -> Mirror:
    """The European aspheric preset with its line, which begins where its sphere ends."""
    raw = spec_as_json(load_spec("european-aspheric"))
    raw["part"] |= {"hand": hand, "transition_mm": transition_mm}
    return design(validate_spec(raw | ({"rules": rules} if rules else {})))


def measured(mirror: Mirror, rule: str = "R46") -> RuleQuantities:
    told = StatedProperties(transition_mm=mirror.spec.part.transition_mm)
    return RuleQuantities.of(Reflector.from_mirror(mirror), load_rule(rule), 38.1, None, told)


def test_line_ends_on_the_outline() -> None:
    """In the middle of a trapezium 200 wide, 100 and 140 high, it is 120 long; in the round corner where the arc is."""
    outline = truck_outline(200.0, 100.0, 140.0, 20.0)
    middle = transition_line(outline, 0.0)
    assert (middle.low_mm, middle.high_mm) == pytest.approx((-60.0, 60.0), abs=1e-6)
    for x in (-98.0, 97.0):
        cut = transition_line(outline, x)
        assert outline.contains([x, x], [cut.low_mm + 1e-3, cut.high_mm - 1e-3]).all()
        assert not outline.contains([x, x], [cut.low_mm - 1e-3, cut.high_mm + 1e-3]).any()


def test_line_beside_the_mirror_is_refused() -> None:
    with pytest.raises(SpecError, match=r"part.transition_mm = -200 lies beside the outline: .* from x = -115.0 to 115.0"):
        aspheric(transition_mm=-200.0)


def test_sphere_has_no_transition() -> None:
    raw = spec_as_json(load_spec("sphere-1250"))
    raw["surface"]["method"] = "sphere"
    raw["part"]["transition_mm"] = 0.0
    with pytest.raises(SpecError, match="part.transition_mm = 0 marks where an aspheric part begins"):
        validate_spec(raw)


def test_both_parts_make_the_whole() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, 24))
        loop = np.stack([100.0 * np.cos(angle), 60.0 * np.sin(angle)], axis=1)
        x = float(rng.uniform(-60.0, 60.0))

        def area(polygon: np.ndarray) -> float:
            a, b = polygon, np.roll(polygon, -1, axis=0)
            return 0.5 * float(np.sum(a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1]))

        right, left = inboard_of(loop, x), outboard_of(loop, x)
        assert right[:, 0].min() == left[:, 0].max() == x
        assert area(right) + abs(area(left)) == pytest.approx(area(loop), rel=1e-12)


def test_cut_into_three_is_refused() -> None:
    u = np.array([[0.0, 0.0], [90.0, 0.0], [90.0, 100.0], [60.0, 100.0], [60.0, 30.0], [30.0, 30.0], [30.0, 100.0],
                  [0.0, 100.0]])
    turned = u[:, ::-1]  # an upright line crosses both arms
    with pytest.raises(TraceError, match="crosses its outline 4 times"):
        inboard_of(turned, 80.0)


@pytest.mark.parametrize("hand", ["left", "right"])
def test_step_holds_the_line_as_a_curve_on_the_surface(hand: str, tmp_path: Path) -> None:
    """In the plate's file and in the sheet's, from edge to edge, to the digits of the file; of a right-hand mirror at −x."""
    from mirror_cad.occt.shapes import free_curves_of, solids_of
    from mirror_cad.occt.step import read_step

    mirror = aspheric(hand)
    x = X_MM if hand == "left" else -X_MM
    for name, write in (("plate.step", mirror.export_step), ("sheet.step", mirror.export_surface_step)):
        write(tmp_path / name)
        read = read_step(tmp_path / name)
        assert len(solids_of(read.shape)) == (1 if name == "plate.step" else 0)
        (curve,) = (each for each in free_curves_of(read.shape, 9) if np.ptp(each[:, 0]) < 1e-9 and abs(each[0, 0] - x) < 1.0)
        assert curve[:, 0] == pytest.approx([x] * 9, abs=1e-9)
        assert curve == pytest.approx(mirror.as_made.surface.evaluate(curve[:, 0], curve[:, 1]), abs=1e-9)
        assert curve[[0, -1], 1] == pytest.approx([-149.0, 149.0], abs=1e-6)
        assert "'transition line'" in (tmp_path / name).read_text("ascii")


def test_drawing_has_the_line_on_a_layer_of_its_own(tmp_path: Path) -> None:
    """And the outline is read back as if it were not there."""
    import ezdxf

    mirror, path = aspheric(), tmp_path / "outline.dxf"
    write_dxf(mirror.outline, path, mirror.transition)
    (drawn,) = (each for each in ezdxf.readfile(path).modelspace() if each.dxf.layer == "TRANSITION")
    assert sorted([tuple(drawn.dxf.start)[:2], tuple(drawn.dxf.end)[:2]]) == [
        pytest.approx((X_MM, -149.0), abs=1e-6), pytest.approx((X_MM, 149.0), abs=1e-6)]
    read = open_outline(path)
    assert read.outline.area_mm2() == pytest.approx(mirror.outline.area_mm2(), rel=1e-12)
    assert "on the layer 'TRANSITION'" in read.notes[0]


def test_each_part_has_its_lines() -> None:
    """The sphere's radius inboard; outboard the least radius, by the reckoning of the preset's own formula, and the width."""
    of = judged(measured(aspheric()), "III")
    assert line(of, "radius_r_mm").value == pytest.approx(1250.0, rel=1e-3)
    assert line(of, "radius_r_mm").notes[0] == "of the main part, inboard of the transition line at x = -23 mm"
    assert line(of, "sphere_departure_mm").verdict == "met"
    assert line(of, "aspheric_width_mm").value == pytest.approx(92.0, abs=1e-6)  # from x = −23 to −115
    # k = 2.33046e-6: at x = −113.2, the outermost place of the grid, κ = 2.0 /m and the reading over 38.1 mm a little less.
    least = line(of, "radius_least_mm").value
    assert least is not None
    assert 493.0 < least < 560.0


def test_aspheric_part_too_narrow_or_too_tight_is_missed() -> None:
    of = judged(measured(aspheric(transition_mm=-86.0)), "III")
    assert line(of, "aspheric_width_mm").value == pytest.approx(29.0, abs=1e-6)
    assert line(of, "aspheric_width_mm").verdict == "missed"


def test_sphere_is_asked_for_no_aspheric_part() -> None:
    of = judged(RuleQuantities.of(sphere(1250.0), load_rule("R46"), 38.1), "III")
    assert not [each for each in of if each.asked.quantity in ("aspheric_width_mm", "radius_least_mm")]


def test_file_without_the_line_leaves_its_width_open() -> None:
    unmarked = RuleQuantities.of(Reflector.from_mirror(aspheric()), load_rule("R46"), 38.1)
    found = line(judged(unmarked, "III"), "aspheric_width_mm")
    assert (found.value, found.verdict) == (None, "open")
    assert "--transition-mm" in found.notes[0]


def test_surface_that_cannot_be_cut_is_said() -> None:
    with pytest.raises(TraceError, match="a transition line at x = 0 mm needs a mirror that is one B-spline"):
        _ = RuleQuantities.of(sphere(1250.0), load_rule("R46"), 38.1, None, StatedProperties(transition_mm=0.0)).main.radii


def test_faces_part_a_file_where_one_of_them_is_a_sphere() -> None:
    """As other programs write aspheric mirrors: the sphere's face and the aspheric one, edge to edge at x = −23."""
    mirror = aspheric()
    loop = mirror.outline.polyline(0.01)
    quadric = Quadric("sphere", np.array([0.0, 0.0, -1250.0]), TOWARDS_Z, 1250.0)
    right = np.array([[-23.0, -140.0], [100.0, -140.0], [100.0, 140.0], [-23.0, 140.0]])
    main = QuadricFace(quadric, (np.arcsin(right / 1250.0),))
    outer = BSplineFace(mirror.surface, (outboard_of(loop, X_MM),))
    m = RuleQuantities.of(Reflector.of_faces((main, outer)), load_rule("R46"), 38.1)
    of = judged(m, "III")
    assert line(of, "radius_r_mm").value == pytest.approx(1250.0, abs=1e-5)
    assert line(of, "radius_r_mm").notes[0] == "of the main part, the spherical one of its faces"
    assert line(of, "sphere_departure_mm").verdict == "met"
    assert line(of, "aspheric_width_mm").value == pytest.approx(92.0, abs=1e-3)
    assert 493.0 < (line(of, "radius_least_mm").value or 0.0) < 600.0  # no foot stands beyond the edge of a face
    one = RuleQuantities.of(Reflector(main), load_rule("R46"), 38.1)
    assert one.main is one


@pytest.mark.parametrize("hand", ["left", "right"])
def test_file_of_ours_says_where_its_aspheric_part_begins(hand: str, tmp_path: Path) -> None:
    """In mirror coordinates, whichever hand it is; another program's file says nothing."""
    path = tmp_path / "mirror.step"
    aspheric(hand).export_step(path)
    assert transition_of(path) == X_MM
    assert hand_of(path) == hand
    found = measured_mirror(RuleRequest(str(path), "R46", "III"), load_rule("R46"), None)[1]
    assert line(judged(found, "III"), "aspheric_width_mm").value == pytest.approx(92.0, abs=1e-6)
    path.write_text(path.read_text("ascii").replace("'mirror-cad'", "'other'"), encoding="ascii")
    assert transition_of(path) is None
