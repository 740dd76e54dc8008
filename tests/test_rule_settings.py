"""A mirror within its adjustment, under loads and behind pillars: ends of ranges, rigid motions, and shares that are known."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mirror_cad.errors import SpecError
from mirror_studio.cli import BAD_INPUT, run
from mirror_studio.rules.ground import field_margin, hidden_share, missing_ground
from mirror_studio.rules.measuring import RuleQuantities
from mirror_studio.rules.mounted import Mounted
from mirror_studio.rules.obstruction import Piece, VehicleBody, obstructed_share
from mirror_studio.rules.run import body_of, loads_of
from mirror_studio.rules.settings import Load, adjusted, lowered, turned_by, under_load
from mirror_studio.rules.verdicts import judged
from mirror_studio.scene_file import load_scene
from raytrace.reflector import Reflector
from raytrace.viewing.pose import Pose, TiltedPose
from raytrace.viewing.vehicle import Eyes
from tests.rule_mirrors import measured, plane, sphere
from tests.test_rule_fields import CENTRE, EYES, HOST, field, required, views
from tests.test_spherometer import line

GALLERY = Path(__file__).parent.parent / "docs" / "rules"


def mounted(yaw_deg: float = 22.0, pitch_deg: float = 3.0, reflector: Reflector | None = None) -> RuleQuantities:
    pose = Pose(CENTRE, np.zeros(3), math.radians(yaw_deg), math.radians(pitch_deg))
    return measured(reflector or sphere(1250.0, 180.0, 240.0)).mounted_as(Mounted(pose, EYES, HOST))


# --- adjustment -------------------------------------------------------------------------------------------------------


def test_range_ends_where_the_field_is_no_longer_seen() -> None:
    """All of class III's field is seen at every end, and a twentieth of a degree beyond it is not; the middle is between."""
    m = mounted(25.0, 5.0)
    best, found = adjusted(m, "III", 6.0)
    assert found.yaw_range_deg is not None
    assert found.pitch_range_deg is not None
    assert found.yaw_deg == pytest.approx(sum(found.yaw_range_deg) / 2.0, abs=0.02)
    assert line(judged(best, "III"), "field_missing_m2").verdict == "met"
    for low_high, turn in ((found.yaw_range_deg, lambda t: (t, found.pitch_deg)),
                           (found.pitch_range_deg, lambda t: (found.yaw_deg, t))):
        for end, way in zip(low_high, (-1.0, 1.0), strict=True):
            assert line(judged(turned_by(m, *turn(end)), "III", {"field_missing_m2"}), "field_missing_m2").verdict == "met"
            if abs(end) < 6.0:
                beyond = judged(turned_by(m, *turn(end + 0.05 * way)), "III", {"field_missing_m2"})
                assert line(beyond, "field_missing_m2").verdict == "missed"


def test_mirror_that_shows_no_such_field_says_so() -> None:
    m = mounted(reflector=plane(40.0, 40.0))
    _, found = adjusted(m, "II", 3.0)
    assert (found.yaw_range_deg, found.pitch_range_deg) == (None, None)
    assert found.margin_m < 0.0
    assert "no setting shows all" in found.words


def test_few_lines_tell_the_same_margin() -> None:
    pair = views(sphere(1200.0, 180.0, 220.0))
    asked = required(field([[4.0, 0.0, 1.0], [20.0, 0.0, 4.0], [np.inf, 0.0, 4.0]]))
    assert field_margin(*pair, asked) == pytest.approx(1e3 * missing_ground(*pair, asked).margin_m, abs=1.0)


@pytest.mark.parametrize(("arguments", "said"), [
    (["--adjust-deg", "5"], "--adjust-deg needs --vehicle"), (["--adjust-deg", "40", "--vehicle", "motorway"], "at most 20"),
    (["--adjust-deg", "5", "--vehicle", "motorway", "--rule", "FMVSS111", "--class", "passenger"], "asks for no field")])
def test_refused(arguments: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rule = [] if "--rule" in arguments else ["--rule", "R46"]
    assert run(["rules", "sphere-1250", *rule, *arguments, "--out", str(tmp_path / "out")]) == BAD_INPUT
    assert said in capsys.readouterr().err


# --- loads ------------------------------------------------------------------------------------------------------------


def test_load_lowers_front_and_rear_by_what_it_says() -> None:
    there = lowered(mounted().on_vehicle.mounted, Load("full", -5.0, 60.0))
    assert isinstance(there.pose, TiltedPose)
    for x, down in ((HOST.front_mm, -5.0), (HOST.rear_mm, 60.0)):
        point = there.pose.tilted(np.array([x, 0.0, 0.0]))
        assert point[2] == pytest.approx(-down, abs=1e-9)
    turn = there.pose.rotation
    assert turn @ turn.T == pytest.approx(np.eye(3), abs=1e-14)


def test_even_load_is_a_lower_vehicle() -> None:
    m, asked = mounted(22.0, 6.0), field([[4.0, 0.0, 1.0], [20.0, 0.0, 4.0], [np.inf, 0.0, 4.0]])
    found = under_load(m, asked, Load("even", 50.0, 50.0))
    there, down = m.on_vehicle.mounted, np.array([0.0, 0.0, 50.0])
    low = m.mounted_as(replace(there, pose=replace(there.pose, centre=CENTRE - down), eyes=Eyes(EYES.middle - down)))
    other = low.on_vehicle.missing(asked)
    assert (found.missing_m2, found.least_margin_m) == pytest.approx((other.missing_m2, other.margin_m), abs=1e-6)
    assert found.seen_to_the_horizon is other.horizon


def test_rear_that_sinks_looks_up_less() -> None:
    """A plane mirror tilted with the body by t turns what it shows by t, not by 2t: eye and mirror turn together."""
    there = mounted().on_vehicle.mounted
    load = Load("rear", 0.0, 72.0)
    low = lowered(there, load)
    normal = there.pose.directions_to_vehicle(np.array([0.0, 0.0, 1.0]))
    turned = low.pose.directions_to_vehicle(np.array([0.0, 0.0, 1.0]))
    tilt = math.asin(72.0 / (HOST.rear_mm - HOST.front_mm))
    assert turned[0] == pytest.approx(normal[0] * math.cos(tilt) + normal[2] * math.sin(tilt), abs=1e-12)
    assert turned[2] == pytest.approx(normal[2] * math.cos(tilt) - normal[0] * math.sin(tilt), abs=1e-12)


# --- what hides -------------------------------------------------------------------------------------------------------


def wall(x: float, y: tuple[float, float], z: tuple[float, float], name: str = "wall") -> Piece:
    return Piece(name, np.array([[x, y[0], z[0]], [x, y[1], z[0]], [x, y[1], z[1]], [x, y[0], z[1]]]))


def test_piece_is_met_inside_its_corners() -> None:
    piece = Piece("slanted", np.array([[0.0, 0.0, 0.0], [100.0, 0.0, 100.0], [100.0, 80.0, 100.0], [0.0, 80.0, 0.0]]))
    starts = np.array([[50.0, 40.0, -100.0], [50.0, 90.0, -100.0], [50.0, 40.0, -100.0], [np.nan] * 3])
    ends = np.array([[50.0, 40.0, 100.0], [50.0, 90.0, 100.0], [50.0, 40.0, 40.0], [0.0] * 3])
    assert piece.meets(starts, ends).tolist() == [True, False, False, False]
    assert piece.off_plane_mm == pytest.approx(0.0, abs=1e-9)


def test_grid_agrees_with_the_exact_share_of_a_box() -> None:
    pair = views(sphere(1200.0, 180.0, 220.0))
    behind = required(field([[4.0, -1.0, 0.0], [8.0, -1.0, 0.0]]))
    exact = hidden_share(*pair, behind, HOST)
    assert 0.1 < exact < 1.0
    assert obstructed_share(*pair, behind, HOST, VehicleBody(), False, 1e5) == pytest.approx(exact, abs=0.01)


def test_pillar_before_both_eyes_hides_all_and_before_one_hides_little() -> None:
    """The field is seen by either eye: what one of them sees counts."""
    pair = views(sphere(1200.0, 180.0, 220.0))
    asked = required(field([[4.0, 0.0, 1.0], [20.0, 0.0, 4.0]]))
    eye, mirror = EYES.middle, CENTRE
    at = eye + 0.6 * (mirror - eye)
    both = VehicleBody(opaque=(wall(at[0], (at[1] - 150.0, at[1] + 150.0), (at[2] - 200.0, at[2] + 200.0)),))
    near = 0.5 * (EYES.right + mirror)
    one = VehicleBody(opaque=(Piece("post", near + np.array([[0.0, -8.0, -300.0], [0.0, 8.0, -300.0], [0.0, 8.0, 300.0],
                                                       [0.0, -8.0, 300.0]])),))
    assert obstructed_share(*pair, asked, HOST, both, False, 1e5) == pytest.approx(1.0)
    assert obstructed_share(*pair, asked, HOST, one, False, 1e5) < 0.2


def test_half_a_field_behind_a_wall_is_half_of_it() -> None:
    """A wall close behind the field's middle line in plan, high enough for all: the outer half of a strip is hidden from a
    mirror that looks along it, but for what rays from different places of the mirror make of the wall's edge."""
    pair = views(plane(200.0, 240.0), 22.0, 0.0)
    asked = required(field([[30.0, 0.0, 4.0], [30.5, 0.0, 4.0]]))
    body = VehicleBody(opaque=(wall(29_900.0, (-2870.0, 2870.0), (-10.0, 3000.0)),))
    free = 1.0 - missing_ground(*pair, asked).missing_m2 / asked.area_m2
    assert obstructed_share(*pair, asked, HOST, body, False, 1e5) == pytest.approx(0.5 * free, abs=0.02)


def test_inside_mirror_looks_out_of_its_windows() -> None:
    """Through a window as large as the body's back it shows all that it shows, through none of a wall's none of it."""
    scene = load_scene(GALLERY / "car-inside.toml")
    body = body_of(scene)
    assert ([each.name for each in body.windows], len(body.opaque), body.inside) == (["rear window"], 2, True)
    assert [each.name for each in loads_of(scene)] == ["five on board and luggage"]
    from mirror_studio.drive.mirrors import on_vehicle

    mirror = on_vehicle("inside", plane(230.0, 60.0), scene)
    asked = line(judged(measured(plane()), "I"), "field_obstructed_percent").asked.field
    assert asked is not None
    at = measured(plane(230.0, 60.0)).mounted_as(Mounted(mirror.pose, mirror.eyes, mirror.host)).on_vehicle
    ground = at.required(asked)

    def share(of: VehicleBody, upright: bool = True) -> float:
        return obstructed_share(at.views.left, at.views.right, ground, mirror.host, of, upright, 1e5)

    wide = wall(2800.0, (-900.0, 900.0), (0.0, 1450.0))
    assert share(VehicleBody(inside=True)) == 0.0
    assert share(VehicleBody(windows=(wide,), inside=True)) == 0.0
    assert share(VehicleBody(windows=(wall(2800.0, (-900.0, 900.0), (0.0, 10.0)),), inside=True)) == pytest.approx(1.0)
    assert 0.0 < share(body) < 0.15


def test_share_on_an_upright_plane_is_that_of_a_screen() -> None:
    """A strip is as wide and as high as 1/X there, so its area to the horizon runs as 1/X²: a wall that hides 60 to 120 m hides
    three quarters, but for rays from higher and lower places of the mirror."""
    pair = views(plane(400.0, 400.0), 22.0, 0.0)
    asked = required(field([[60.0, 0.0, 4.0], [np.inf, 0.0, 4.0]]))
    # From the mirror's height h over X: a wall at 59 m as high as the ray to 120 m passes there.
    height, away = CENTRE[2], 59_000.0 - CENTRE[0]
    top = height * (1.0 - away / (120_000.0 - CENTRE[0]))
    body = VehicleBody(opaque=(wall(59_000.0, (-9000.0, 9000.0), (-10.0, top)),))
    found = obstructed_share(*pair, asked, HOST, body, True, 1e5)
    assert found == pytest.approx(0.75, abs=0.05)


@pytest.mark.parametrize(("text", "said"), [
    ('[mirror]\ninside = true\n', "inside = true needs yaw_deg and pitch_deg"),
    ('[own_vehicle]\nopaque = [{ name = "A", corners_m = [[0.0, 0.0, 1.0], [0.0, 1.0, 1.0]] }]\n',
     "'A' has 2 corners: a flat piece has three or more"),
    ('[[load]]\nname = "full"\nfront_m = 2.0\nrear_m = 0.0\n', "load.0.front_m = 2.0: must be at least -1 and at most 1")])
def test_faults_of_a_scene(text: str, said: str, spec_file: Callable[..., Path]) -> None:
    with pytest.raises(SpecError) as caught:
        load_scene(spec_file(f'name = "x"\n{text}', "x.toml"))
    assert said in str(caught.value)


def test_piece_that_is_not_flat_is_refused(spec_file: Callable[..., Path]) -> None:
    corners = "[[0.0, 0.0, 1.0], [0.0, 1.0, 1.0], [0.2, 1.0, 2.0], [0.0, 0.0, 2.0]]"
    scene = load_scene(spec_file(f'name = "x"\n[[own_vehicle.opaque]]\nname = "A pillar"\ncorners_m = {corners}\n', "x.toml"))
    with pytest.raises(SpecError, match=r"the corners of 'A pillar' are \d+ mm off one plane, at most 5"):
        body_of(scene)
