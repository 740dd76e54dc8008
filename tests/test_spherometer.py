"""A spherometer of stated leg distance: what it reads on surfaces whose sections are circles, and where a verdict turns."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq

from mirror_studio.rules.radii import Radii
from mirror_studio.rules.spherometer import ReadingError, radius_of, read_surface, reading_error, readings, stands_at, turned
from mirror_studio.rules.verdicts import RuleLine, judged
from tests.rule_mirrors import cylinder, measured, plane, sphere, torus

Array = NDArray[np.float64]

CLOSED_MM = 1e-9  # of a radius of a metre, where heights are those of the closed form itself
# On a face its points are known to the rounding of coordinates, 1e-13 mm at a metre: of the sagitta, 0.15 mm, 1e-12.
FACE_MM = 4e-9
SPLINE_MM = 2e-6  # the torus is a spline, right to 1e-10 mm


def line(of: list[RuleLine], quantity: str) -> RuleLine:
    found = [each for each in of if each.asked.quantity == quantity]
    assert len(found) == 1, quantity
    return found[0]


def circle_heights(radius: float) -> object:
    return lambda s: -s * s / (radius + np.sign(radius) * np.sqrt(radius * radius - s * s))


@pytest.mark.parametrize("leg_mm", [12.0, 38.1, 75.0])
@pytest.mark.parametrize("radius", [200.0, 1199.9, 1651.0, -950.0, 30.5 * 38.1])
def test_section_that_is_a_circle_reads_its_radius(radius: float, leg_mm: float) -> None:
    """Spheres in any direction; cylinders across; the tube and the equator of a torus. Negative is hollow."""
    assert readings(circle_heights(radius), 3, leg_mm) == pytest.approx([radius] * 3, abs=CLOSED_MM)  # type: ignore[arg-type]


def test_section_of_a_cylinder_aslant_reads_its_ellipse() -> None:
    """At 45° the section is an ellipse of half axes r√2 and r, and at the end of its minor axis the circle through three of its
    points that lie evenly is x² = (C/2)², with the sagitta r(1 − √(1 − x²/2r²))."""
    r, leg = 900.0, 38.1
    x = leg / 2.0
    sagitta = 0.5 * x * x / r / (1.0 + np.sqrt(1.0 - 0.5 * (x / r) ** 2))
    found = readings(lambda s: -0.5 * s * s / r / (1.0 + np.sqrt(1.0 - 0.5 * (s / r) ** 2)), 1, leg)
    assert found[0] == pytest.approx(float(radius_of(leg, sagitta)), abs=CLOSED_MM)
    aslant = read_surface(cylinder(r).surface, turned(stands_at(cylinder(r).surface, np.zeros((1, 2)), np.array([1.0, 0.0])),
                                                      np.pi / 4), leg)
    assert aslant[0] == pytest.approx(found[0], abs=2 * FACE_MM)


def test_plane_is_flat() -> None:
    assert np.isinf(readings(np.zeros_like, 2, 38.1)).all()
    m = measured(plane())
    assert m.radii.flat
    assert m.radii.mean == np.inf
    assert m.radii.readings_spread_percent == m.radii.means_spread_percent == 0.0
    found = line(judged(m, "III"), "radius_r_mm")
    assert (found.value, found.verdict, found.notes[0]) == (None, "met", "flat")


@pytest.mark.parametrize("radius", [300.0, 1199.9, 1651.0])
def test_sphere_face_reads_its_radius_everywhere(radius: float) -> None:
    for rule in ("R46", "FMVSS111"):
        radii = measured(sphere(radius), rule).radii
        assert np.abs(radii.readings - radius).max() < FACE_MM * (radius / 1000.0) ** 2 + CLOSED_MM, rule


def test_cylinder_is_flat_along_its_axis_and_its_radius_across() -> None:
    m = measured(cylinder(1000.0))
    across, along = m.radii.readings.T  # the level arc is the longer one: along it first
    assert np.isinf(along).all()
    assert across == pytest.approx([1000.0] * 3, abs=FACE_MM)
    assert m.radii.readings_spread_percent == np.inf


def test_torus_reads_equator_and_tube() -> None:
    level, upright = measured(torus(1400.0, 1100.0)).radii.readings.T
    assert level == pytest.approx([1400.0] * 3, abs=SPLINE_MM)
    assert upright == pytest.approx([1100.0] * 3, abs=SPLINE_MM)
    assert np.array(measured(torus(1400.0, 1100.0, 100.0, 180.0)).radii.at)[:, 0] == pytest.approx([0.0] * 3, abs=1e-12)


def test_points_stand_at_thirds_of_the_longer_arc() -> None:
    """Of 1000·arcs the third parts lie at sin(±30/1000)·1000 mm of a level arc of 180 mm."""
    at = measured(sphere(1000.0)).radii.at
    assert at[:, 0] == pytest.approx(1000.0 * np.sin([-0.03, 0.0, 0.03]), abs=1e-4)
    assert at[:, 1] == pytest.approx([0.0] * 3, abs=1e-12)


# --- verdicts ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("radius", "name", "verdict"), [
    (1199.9, "II", "missed"), (1200.1, "II", "met"), (1199.9, "I", "missed"), (1200.1, "I", "met"), (299.9, "IV", "missed"),
    (300.1, "V", "met"), (199.9, "VI", "missed"), (200.1, "VI", "met"), (999.9, "VII", "missed"), (1500.1, "VII", "missed"),
    (1499.9, "VII", "met"), (1200.0, "III", "met")])
def test_least_radius_of_each_class(radius: float, name: str, verdict: str) -> None:
    found = line(judged(measured(sphere(radius)), name), "radius_r_mm")
    assert found.verdict == verdict
    assert found.value == pytest.approx(radius, abs=1e-6)
    assert found.margin == pytest.approx(min(end for end in (radius - found.limit[0], found.limit[1] - radius)), abs=1e-6)


@pytest.mark.parametrize(("radius", "verdict"), [(888.9, "missed"), (889.1, "met"), (1650.9, "met"), (1651.1, "missed")])
def test_radii_of_an_american_passenger_side(radius: float, verdict: str) -> None:
    assert line(judged(measured(sphere(radius), "FMVSS111"), "passenger"), "radius_r_mm").verdict == verdict


@pytest.mark.parametrize(("percent", "mean", "verdict"), [(14.99, 1300.0, "met"), (15.01, 1300.0, "missed"),
                                                          (24.99, 3100.0, "met"), (25.01, 3100.0, "missed")])
def test_spread_of_two_readings(percent: float, mean: float, verdict: str) -> None:
    """On a torus whose equator and tube are the mean, that many percent more and less."""
    share = percent / 100.0
    m = measured(torus(mean * (1.0 + share), mean * (1.0 - share)))
    found = line(judged(m, "III"), "radius_ri_spread_percent")
    assert found.value == pytest.approx(percent, abs=1e-6)
    assert found.verdict == verdict


@pytest.mark.parametrize(("percent", "verdict"), [(12.49, "met"), (12.51, "missed")])
def test_spread_of_ten_readings(percent: float, verdict: str) -> None:
    """On a torus by its own ten sections: upright ones are the tube, level ones at y = 0 the equator, and level ones at y = ±30
    are taken from the torus's equation here, in the plane of the normal and x."""
    tube, leg = 1100.0, 38.1

    def off_equator(equator: float) -> float:
        """The reading in the level direction half way to the upper edge, by roots of the torus's equation."""
        y, big = 30.0, equator - tube
        normal = np.array([0.0, y, np.sqrt(tube**2 - y**2)]) / tube
        foot = np.array([0.0, y, np.sqrt(tube**2 - y**2) + big])

        def height(s: float) -> float:
            def equation(h: float) -> float:
                x, up, z = foot + h * normal + np.array([s, 0.0, 0.0])
                return float((np.hypot(x, z) - big) ** 2 + up**2 - tube**2)

            return float(brentq(equation, -2.0, 2.0, xtol=1e-15))

        # Symmetric in s, so that the feet are at ±C/2.
        return float(radius_of(leg, -height(0.5 * leg)))

    def spread(equator: float) -> float:
        of = np.array([tube] * 5 + [equator] * 3 + [off_equator(equator)] * 2)
        return float(100.0 * np.abs(of - of.mean()).max() / of.mean())

    equator = brentq(lambda each: spread(each) - percent, 1200.0, 1600.0, xtol=1e-10)
    m = measured(torus(equator, tube), "FMVSS111")
    # The upright sections beside x = 0 are in planes through the axis as well.
    found = line(judged(m, "passenger"), "radius_ri_spread_percent")
    assert found.value == pytest.approx(percent, abs=1e-5)
    assert found.verdict == verdict


def test_spread_of_point_means() -> None:
    """|r_p − r| of three points: 1000, 1200, 1100 lie 100 off 1100."""
    radii = Radii(np.zeros((3, 2)), np.array([[990.0, 1010.0], [1200.0, 1200.0], [1050.0, 1150.0]]))
    assert radii.means_spread_percent == pytest.approx(100.0 / 11.0)
    assert radii.readings_spread_percent == pytest.approx(50.0 / 11.0)


# --- the instrument ---------------------------------------------------------------------------------------------------


def test_dial_error_as_sae_has_it() -> None:
    """At r = 1200 mm and C = 38.1 mm the sagitta is 0.151 mm, and 1 µm of dial is 0.66 % of the radius."""
    assert float(radius_of(38.1, 0.1512)) == pytest.approx(1200.0, rel=1e-3)
    assert reading_error(1200.0, 38.1, 0.001) / 1200.0 == pytest.approx(0.0066, abs=5e-5)
    h = 1e-6
    sagitta = 0.151
    slope = (radius_of(38.1, sagitta + h) - radius_of(38.1, sagitta - h)) / (2 * h)
    assert reading_error(float(radius_of(38.1, sagitta)), 38.1, 1.0) == pytest.approx(abs(float(slope)), rel=1e-6)
    assert reading_error(np.inf, 38.1) == np.inf
    with pytest.raises(ReadingError, match="cannot stand on a radius of 15 mm"):
        reading_error(15.0, 38.1)


def test_foot_beside_the_sheet_is_said() -> None:
    with pytest.raises(ReadingError, match="shorter --leg-mm"):
        _ = measured(torus(1400.0, 1100.0), leg_mm=280.0).radii


@pytest.mark.parametrize("at", [-60.0, -10.0, 23.0, 30.0, 90.0])
@pytest.mark.parametrize("leg_mm", [12.0, 38.1])
def test_european_aspheric_reads_its_own_curve(at: float, leg_mm: float) -> None:
    """y = R − √(R² − x²) + k(x − a)³ beyond a (UN R46, 2.1.1.10), with 40 digits: the feet by roots of the curve's equation,
    the radius that of the circle through the three points. The instrument gets heights above the touching line, rounded."""
    import mpmath as mp

    with mp.workdps(40):
        big, k, a, x0 = mp.mpf(1250), mp.mpf("2.33046e-6"), mp.mpf(23), mp.mpf(at)

        def curve(x: mp.mpf) -> mp.mpf:
            return -(big - mp.sqrt(big**2 - x**2) + (k * (x - a) ** 3 if x > a else 0))

        slope = -(x0 / mp.sqrt(big**2 - x0**2) + (3 * k * (x0 - a) ** 2 if x0 > a else 0))
        length = mp.sqrt(1 + slope**2)

        def along_and_up(x: mp.mpf) -> tuple[mp.mpf, mp.mpf]:
            dx, dz = x - x0, curve(x) - curve(x0)
            return (dx + slope * dz) / length, (dz - slope * dx) / length

        def root(f: object, near: mp.mpf) -> mp.mpf:
            return mp.findroot(f, (near - 1, near + 1), solver="secant", tol=1e-60, maxsteps=60)

        def heights(along: Array) -> Array:
            with mp.workdps(40):
                return np.array([[float(along_and_up(root(lambda x, s=s: along_and_up(x)[0] - mp.mpf(float(s)),
                                                          x0 + mp.mpf(float(s)) / length))[1]) for s in row] for row in along])

        def foot(reach: mp.mpf, side: int) -> mp.mpf:
            return root(lambda x: mp.hypot(x - x0, curve(x) - curve(x0)) - reach, x0 + side * reach / length)

        def apart(reach: mp.mpf) -> mp.mpf:
            low, high = foot(reach, -1), foot(reach, 1)
            return mp.hypot(high - low, curve(high) - curve(low)) - mp.mpf(leg_mm)

        reach = mp.findroot(apart, (mp.mpf(leg_mm) / 2, mp.mpf(leg_mm) / 2 * mp.mpf("1.001")), tol=1e-50)
        p, q, r = ((x - x0, curve(x) - curve(x0)) for x in (foot(reach, -1), x0, foot(reach, 1)))
        sides = [mp.hypot(u[0] - v[0], u[1] - v[1]) for u, v in ((p, q), (q, r), (r, p))]
        twice_area = abs((q[0] - p[0]) * (r[1] - p[1]) - (r[0] - p[0]) * (q[1] - p[1]))
        wanted = float(sides[0] * sides[1] * sides[2] / (2 * twice_area))
    assert readings(heights, 1, leg_mm)[0] == pytest.approx(wanted, abs=CLOSED_MM)
