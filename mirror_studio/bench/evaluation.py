"""Time per point of points, normals and curvatures of a B-spline, by each method of evaluation."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import NdBSpline

from mirror_cad.design_stages import design
from mirror_cad.occt import peers
from mirror_cad.spec.file import load_spec
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.differential import normals, principal_curvatures_of, shape_operator
from mirror_studio.bench.measuring import median_seconds
from mirror_studio.bench.table import Column, Plot, Row, Table

Array = NDArray[np.float64]
Evaluation = Callable[[Array, Array], tuple[Array, Array, Array]]

SIDES = (32, 317, 1000)  # places a direction: 10³, 10⁵ and 10⁶ in all
LARGEST_FOR_PEERS = 317  # ten seconds would go into a million of theirs
ORDERS = {"s": (0, 0), "u": (1, 0), "v": (0, 1), "uu": (2, 0), "uv": (1, 1), "vv": (0, 2)}
ORACLE = "OCCT GeomLProp_SLProps, point by point"
SCATTERED = "ours, scattered (derivatives)"
ON_GRID = "ours, tensor grid (on_grid)"
SCIPY = "scipy NdBSpline, scattered"
WAYS = (ORACLE, SCIPY, SCATTERED, ON_GRID)


def tables(sides: tuple[int, ...] = SIDES) -> tuple[Table, ...]:
    """Time per point and disagreement of curvature with the kernel's own."""
    mirror = design(load_spec("progressive-c"))
    surface, (x_min, x_max, y_min, y_max) = mirror.surface, mirror.box
    oracle = peers.local_properties(surface)
    rows: list[Row] = []
    for side in sides:
        x, y = np.linspace(x_min, x_max, side), np.linspace(y_min, y_max, side)
        shuffled = np.random.default_rng(side).permutation(side * side)
        scattered = x[shuffled // side], y[shuffled % side]
        methods: list[tuple[str, Evaluation, tuple[Array, Array]]] = [
            (SCATTERED, lambda u, v: _properties(surface.derivatives(u, v)), scattered),
            (ON_GRID, lambda u, v: _properties(surface.on_grid(u, v)), (x, y))]
        truth = None
        if side <= LARGEST_FOR_PEERS:
            methods = [(ORACLE, oracle, scattered), (SCIPY, by_scipy(surface), scattered), *methods]
            truth = oracle(*scattered)[2]
        for method, evaluate, points in methods:
            seconds = median_seconds(partial(evaluate, *points))
            row = {"method": method, "points": side * side, "time_us": 1e6 * seconds / side**2, "disagreement": None}
            if truth is not None and method != ORACLE:
                kappa = evaluate(*points)[2].reshape(-1, 2)
                kappa = kappa[shuffled] if method == ON_GRID else kappa
                row["disagreement"] = float(np.abs(kappa / truth - 1.0).max())
            rows.append(row)
    rows.sort(key=lambda row: WAYS.index(row["method"]))
    text = ("Point, unit normal and both principal curvatures of the B-spline of progressive-c (degree "
            f"{surface.degree_u}, {len(surface.poles)} × {len(surface.poles[0])} poles), at the same places in shuffled order, "
            "or as the grid that they are. The kernel is called from Python once for each point, and is the oracle: the last "
            "column is the largest relative difference of a principal curvature from its. There is no step here; the floor "
            "is the rounding of second derivatives.")
    columns = (Column("method", "evaluation"), Column("points", "points"), Column("time_us", "time, µs per point"),
               Column("disagreement", "largest κ difference, relative"))
    return (Table("evaluation", "Evaluation of points, normals and curvatures", text, columns, tuple(rows),
                  (Plot("points", "time_us", "method", "Time per point over points"),)),)


def by_scipy(surface: BSplineSurface) -> Evaluation:
    """scipy's tensor-product spline, evaluated for S and each of its five derivatives."""
    spline = NdBSpline((surface.knots_u, surface.knots_v), surface.poles, (surface.degree_u, surface.degree_v))

    def evaluate(u: Array, v: Array) -> tuple[Array, Array, Array]:
        points = np.stack([u, v], axis=1)
        return _properties({key: spline(points, nu=order) for key, order in ORDERS.items()})

    return evaluate


def _properties(d: dict[str, Array]) -> tuple[Array, Array, Array]:
    return d["s"], normals(d["u"], d["v"]), np.stack(principal_curvatures_of(shape_operator(d)), axis=-1)
