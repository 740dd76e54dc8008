"""The figures of a deviation against closed forms: a sphere asked for and another made, a saddle, facets of a sphere."""

from __future__ import annotations

import numpy as np
import pytest

from mirror_cad.designed import DesignedCurvature
from mirror_cad.deviation import against_design
from mirror_cad.grid import Grid
from mirror_cad.mesh import SurfaceMesh
from mirror_cad.mesh_deviation import stl_deviation
from mirror_cad.outline import Outline
from mirror_cad.outline.segments import Arc
from mirror_cad.sections import Sag
from mirror_cad.stage_deviation import StageDeviation
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.collocation import collocate_height
from mirror_cad.surfaces.piecewise import PiecewiseChebyshev
from mirror_cad.surfaces.sphere import SphericalSag
from raytrace.surfaces.differentials import Array

REACH = 60.0  # mm, of the round outline about the origin
ASKED, MADE = 1000.0, 900.0  # mm, radii
ROUND = Outline((Arc((0.0, 0.0), REACH, 0.0, 2.0 * np.pi),))


def constant(value: float) -> PiecewiseChebyshev:
    return PiecewiseChebyshev(np.array([-100.0, 100.0]), np.array([[value, 0.0]]))


def sheet(sag: Sag) -> BSplineSurface:
    """Degree 9 on 4 × 4 spans: these surfaces to some 1e-12 of their curvature."""
    knots = np.concatenate([np.full(9, -70.0), np.linspace(-70.0, 70.0, 5), np.full(9, 70.0)])
    return collocate_height(sag.height, knots, knots, 9)


def sphere_for_another() -> StageDeviation:
    asked = DesignedCurvature(constant(1.0 / ASKED), constant(1.0 / ASKED))
    return against_design(asked, ROUND, SphericalSag(1.0 / ASKED), sheet(SphericalSag(1.0 / MADE)))


def test_a_sphere_for_another_deviates_everywhere_by_the_ratio_of_their_radii() -> None:
    found = sphere_for_another()
    percent, per_m = 100.0 * (ASKED / MADE - 1.0), 1e3 / MADE - 1e3 / ASKED
    # W is the identity over R: all four are that ratio, at their largest and on average.
    for one in (found.k1, found.k2, found.kx, found.ky):
        assert one.max_percent == pytest.approx(percent, rel=1e-8)
        assert one.rms_percent == pytest.approx(percent, rel=1e-8)
        assert one.max_per_m == pytest.approx(per_m, rel=1e-8)
    assert found.twist.max_per_m == pytest.approx(0.0, abs=1e-9)
    assert found.shape.max_percent == pytest.approx(percent, rel=1e-8)
    assert found.shape.rms_percent == pytest.approx(percent, rel=1e-8)
    assert found.shape.max_per_m == pytest.approx(np.sqrt(2.0) * per_m, rel=1e-8)
    assert found.shape.rms_per_m == pytest.approx(np.sqrt(2.0) * per_m, rel=1e-8)
    assert found.largest_principal_percent == pytest.approx(percent, rel=1e-8)
    assert found.largest_principal_per_m == pytest.approx(per_m, rel=1e-8)


def test_each_curvature_is_in_percent_of_its_own_design_and_twist_of_the_whole() -> None:
    """A sphere where 1/Rx and 1/Ry differ, either of them the larger; and a floor where one of them is none."""
    made = 1.0 / MADE
    for kx, ky in ((1e-3, 2e-3), (2e-3, 1e-3), (1e-3, 0.0)):
        asked = DesignedCurvature(constant(kx), constant(ky))
        found = against_design(asked, ROUND, SphericalSag(1e-3), sheet(SphericalSag(made)))
        rms = np.hypot(kx, ky)

        def percent(asked: float, rms: float = rms) -> float:
            return float(100.0 * (made - asked) / max(asked, 0.01 * rms))

        for one, kappa in ((found.kx, kx), (found.ky, ky), (found.k1, max(kx, ky)), (found.k2, min(kx, ky))):
            assert one.max_percent == pytest.approx(percent(kappa), rel=1e-8)
            assert one.rms_percent == pytest.approx(abs(percent(kappa)), rel=1e-8)
        assert found.shape.max_percent == pytest.approx(100.0 * np.hypot(made - kx, made - ky) / rms, rel=1e-8)
    saddle = against_design(DesignedCurvature(constant(3e-3), constant(4e-3)), ROUND, SphericalSag(0.0),
                            sheet(Saddle()))  # type: ignore[arg-type]
    assert saddle.twist.max_percent == pytest.approx(-100.0 * Saddle.c / 5e-3, rel=2e-6)


def test_sag_and_slope_of_a_sphere_for_another_are_largest_on_the_edge() -> None:
    found = sphere_for_another()

    def sag(radius: float) -> float:
        return float(np.sqrt(radius**2 - REACH**2) - radius)

    turn = np.arcsin(REACH / MADE) - np.arcsin(REACH / ASKED)
    assert found.sag_max_mm == pytest.approx(sag(MADE) - sag(ASKED), rel=1e-9)
    assert found.slope_max_arcsec == pytest.approx(3600.0 * np.degrees(turn), rel=1e-9)
    for at in (found.sag_max_at_mm, found.slope_max_at_mm):
        assert np.hypot(*at) == pytest.approx(REACH, rel=1e-12)


class Saddle:
    """z = c·x·y: W12 = −c and W11 = W22 = 0 at the origin, and less of it elsewhere."""

    c = 1e-3

    def height(self, x: Array, y: Array) -> Array:
        return self.c * np.asarray(x) * np.asarray(y)

    derivatives = SphericalSag(0.0).derivatives  # what the slope is against, of no account here


def test_twist_counts_twice_in_the_whole_shape_operator() -> None:
    """‖W‖² = κ1² + κ2²: of a saddle with κ = ±c twice c², in whatever axes it is written."""
    flat = DesignedCurvature(constant(0.0), constant(0.0))
    found = against_design(flat, ROUND, SphericalSag(0.0), sheet(Saddle()))  # type: ignore[arg-type]
    # Of values that differ by less than SAME_SIZE, 1e-6, the upper one's is said: about the origin.
    assert found.twist.max_per_m == pytest.approx(-1e3 * Saddle.c, rel=2e-6)
    assert (found.k1.max_per_m, found.k2.max_per_m) == pytest.approx((1e3 * Saddle.c, -1e3 * Saddle.c), rel=2e-6)
    assert found.shape.max_per_m == pytest.approx(np.sqrt(2.0) * 1e3 * Saddle.c, rel=2e-6)
    assert np.hypot(*found.shape.max_at_mm) < 2.0
    # The average of 4H² − 2K over the disc, by quadrature of the textbook's H and K.
    r, weights = np.polynomial.legendre.leggauss(40)
    r, weights = 0.5 * REACH * (r + 1.0), 0.5 * REACH * weights
    angle = 2.0 * np.pi * np.arange(64) / 64
    x, y = r[:, None] * np.cos(angle), r[:, None] * np.sin(angle)
    p, q = Saddle.c * y, Saddle.c * x
    n2 = 1.0 + p * p + q * q
    mean, gauss = p * q * Saddle.c / n2**1.5, -(Saddle.c**2) / n2**2
    square = (4.0 * mean**2 - 2.0 * gauss).mean(axis=1)
    average = np.sqrt(np.sum(weights * r * square) * 2.0 / REACH**2)
    # Cells at the edge are in or out: the area is counted to 1e-4, and what is averaged changes over it by 1 %.
    assert found.shape.rms_per_m == pytest.approx(1e3 * average, rel=1e-6)


def test_the_grid_passes_over_no_point_by_more_than_a_cell_and_counts_the_area() -> None:
    grid = Grid.over(ROUND)
    cell = np.diff(grid.cells_x)[0] * np.diff(grid.cells_y)[0]
    # A cell counts whose centre lies inside: what is missed of some 1700 cells at the edge is as often in as out.
    assert grid.weights.sum() * cell == pytest.approx(ROUND.area_mm2(), rel=3e-4)
    edge = np.stack([grid.x[grid.edge], grid.y[grid.edge]], axis=1)
    assert np.abs(np.hypot(*edge.T) - REACH).max() < 1e-12
    assert len(edge) == pytest.approx(2000, abs=2)
    gaps = np.linalg.norm(np.diff(edge, axis=0), axis=1)
    assert gaps.max() < 1.01 * ROUND.area_mm2() * 2.0 / REACH / 2000


def test_largest_values_between_cells_are_missed_by_half_a_cell_at_most() -> None:
    """The top of a bump of 4 mm, wherever it lies, is found to what the worst half cell lets it fall."""
    grid = Grid.over(ROUND)
    half_x, half_y = 0.5 * 2.0 * REACH / 211, 0.5 * 2.0 * REACH / 311
    least = np.exp(-(half_x**2 + half_y**2) / 4.0**2)
    chance = np.random.default_rng(15)
    for x, y in chance.uniform(-40.0, 40.0, (50, 2)):
        top = np.exp(-((grid.x - x) ** 2 + (grid.y - y) ** 2) / 4.0**2).max()
        assert least - 1e-12 <= top <= 1.0


def facets(corners: list[list[float]], faces: list[list[int]], radius: float) -> SurfaceMesh:
    at = np.array(corners)
    z = np.sqrt(radius**2 - (at**2).sum(axis=1)) - radius
    return SurfaceMesh(np.column_stack([at, z]), np.array(faces, dtype=np.int32))


def test_a_facet_strays_most_from_a_sphere_at_the_middle_of_its_long_edge_or_at_its_own() -> None:
    """The sphere is R − √(R² − c²/4) from a chord of length c, and R − √(R² − ρ²) from the centre of a facet's circle ρ."""
    sphere = sheet(SphericalSag(1.0 / MADE))
    # Flat-angled, its circumcentre far outside: the middle of the long edge.
    flat = facets([[-20.0, 0.0], [20.0, 0.0], [0.0, 4.0]], [[0, 1, 2]], MADE)
    chord = np.linalg.norm(flat.vertices[1] - flat.vertices[0])
    found = stl_deviation(flat, sphere, ROUND)
    assert found.facets == 1
    # The distance along the normal is taken to first order: short of it by its square over 2R.
    assert found.height_max_mm == pytest.approx(MADE - np.sqrt(MADE**2 - 0.25 * chord**2), rel=1e-3)
    # Equilateral: its own middle, where its normal is the sphere's.
    turn = np.radians([90.0, 210.0, 330.0])
    even = facets((30.0 * np.stack([np.cos(turn), np.sin(turn)], axis=1)).tolist(), [[0, 1, 2]], MADE)
    found = stl_deviation(even, sphere, ROUND)
    assert found.height_max_mm == pytest.approx(MADE - np.sqrt(MADE**2 - 30.0**2), rel=1e-6)
    assert found.normal_max_deg == pytest.approx(0.0, abs=1e-6)


def test_the_angle_of_a_facet_is_that_between_its_middle_and_its_circumcentre() -> None:
    """A facet's normal runs through the sphere's centre and the circumcentre; the sphere's at the middle through that."""
    mesh = facets([[0.0, 0.0], [30.0, 0.0], [5.0, 25.0]], [[0, 1, 2]], MADE)
    centre = np.array([0.0, 0.0, -MADE])
    a, b, c = mesh.vertices
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal)
    middle = mesh.vertices.mean(axis=0)
    foot = sheet(SphericalSag(1.0 / MADE)).evaluate(middle[:1], middle[1:2])[0] - centre  # above it along z
    angle = np.degrees(np.arccos(normal @ foot / MADE))
    found = stl_deviation(mesh, sheet(SphericalSag(1.0 / MADE)), ROUND)
    assert found.normal_max_deg == pytest.approx(angle, rel=1e-9)
    assert found.normal_max_deg > 0.2
