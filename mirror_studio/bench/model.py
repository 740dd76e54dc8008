"""Predicted beside measured curvature of the decoupled surface, by the closed forms of docs/derivations."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import mirror_cad
from mirror_cad import laws
from mirror_cad.grid import Grid
from mirror_cad.mirror import Mirror
from mirror_cad.profile import Profile, integrate_exactly, sine_of_tangent_angle
from mirror_cad.sections import DecoupledSag
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.differential import ShapeOperator, principal_curvatures_of, shape_operator, shape_operator_of_sag
from mirror_cad.surfaces.fit import FitTask, fit_by_collocation
from mirror_cad.surfaces.piecewise import PiecewiseChebyshev, approximate
from mirror_studio.bench.table import Column, Row, Table

Array = NDArray[np.float64]

PRESETS = ("progressive-a", "progressive-b", "progressive-c", "sphere-950")
LEVELLED = "progressive-c"  # the preset whose level point is moved
LEVELS: tuple[float | str, ...] = ("left", -57.5, "centre", 57.5, "right")
SHEET = (-125.0, 125.0, -190.0, 190.0)  # x and y of a surface of revolution, mm: the default blank
FIT_MM, FIT_PERCENT = 1e-5, 0.01  # the specification's own defaults
TERMS = {"w12": "W12", "w22": "W22 − 1/Ry", "w11": "W11 − 1/Rx"}
PER_KM = 1e6  # 1/mm to 1/km
# The fit's tolerance, 0.01 % of some 800 per km, is 0.08 per km; a tenth of that is the last figure that is shown.
LAST_FIGURE_PER_KM = 0.01
# Below this a figure is printed as rounding, %: its digits differ from machine to machine. Reached: 5e-11.
ROUNDING_PERCENT = 1e-9
LAST_FIGURE_OF_RATIOS = 9  # decimals of an angle in degrees or a slope that are not rounding


# --- the formulas ----------------------------------------------------------------------------------------------------


class Sections(NamedTuple):
    """What the two sections of a surface are at x (n,): tan θ of the profile, κ_x = 1/Rx, κ_y of the circles, κ_y′, κ_y″."""

    slope: Array
    kappa_x: Array
    kappa_y: Array
    dkappa_y: Array
    d2kappa_y: Array


def sections_at(profile: Profile, horizontal: PiecewiseChebyshev, vertical: PiecewiseChebyshev, x: Array) -> Sections:
    """`horizontal` is κ_x(x), which the profile realises; `vertical` the curvature of the circles in x = const, 1/mm."""
    first = vertical.derivative()
    return Sections(-profile.slope(x), horizontal(x), vertical(x), first(x), first.derivative()(x))


def exact_shape(at: Sections, y: Array) -> ShapeOperator:
    """The shape operator of circles of curvature κ_y(x) in the planes x = const on a profile of curvature κ_x(x), 1/mm.

    With w = √(1 − κ_y²·y²), a = κ_y′·y²/(1 + w), tan ψ = w·tan θ + a:
    W12 = cos²ψ·y·(κ_y′ − κ_y²·tan θ),  W22 = κ_y·cos ψ,
    W11 = cos³ψ·[w·κ_x/cos³θ + κ_y″·y²/(1 + w) − κ_y·(a² + 2a(1 + w)·tan θ − (1 − w²)·tan²θ)].
    Source: docs/derivations/decoupled-surface.md.
    """
    t, kappa_x, kappa_y, dkappa_y, d2kappa_y = at
    w = np.sqrt((1.0 - kappa_y * y) * (1.0 + kappa_y * y))
    a = dkappa_y * y**2 / (1.0 + w)
    cosine = 1.0 / np.hypot(1.0, w * t + a)
    bracket = (w * kappa_x * (1.0 + t * t) ** 1.5 + d2kappa_y * y**2 / (1.0 + w)
               - kappa_y * (a * a + 2.0 * a * (1.0 + w) * t - (kappa_y * y * t) ** 2))
    return ShapeOperator(cosine**3 * bracket, cosine * kappa_y, cosine**2 * y * (dkappa_y - kappa_y**2 * t))


def leading_terms(at: Sections, y: Array) -> ShapeOperator:
    """What the realised shape operator differs by from diag(κ_x, κ_y), to the leading orders in the slopes, 1/mm.

    With ψ = tan θ + κ_y′·y²/2:  W12 ≈ y·(κ_y′ − κ_y²·tan θ),  W22 − κ_y ≈ −κ_y·ψ²/2,
    W11 − κ_x ≈ κ_y″·y²/2 − κ_x·(κ_y²·y² + 3ψ² − 3tan²θ)/2 − 2·κ_y·κ_y′·y²·tan θ − κ_y·κ_y′²·y⁴/4 + κ_y″·y²·(κ_y²·y²/8 − 3ψ²/4).
    """
    t, kappa_x, kappa_y, dkappa_y, d2kappa_y = at
    psi = t + 0.5 * dkappa_y * y**2
    w11 = (0.5 * d2kappa_y * y**2 - 0.5 * kappa_x * ((kappa_y * y) ** 2 + 3.0 * psi**2 - 3.0 * t**2)
           - 2.0 * kappa_y * dkappa_y * y**2 * t
           - 0.25 * kappa_y * (dkappa_y * y**2) ** 2 + d2kappa_y * y**2 * (0.125 * (kappa_y * y) ** 2 - 0.75 * psi**2))
    return ShapeOperator(w11, -0.5 * kappa_y * psi**2, y * (dkappa_y - kappa_y**2 * t))


def twist_gradient(at: Sections) -> Array:
    """∂W12/∂s across y = 0 of every surface, symmetric in y, whose two curvatures along y = 0 are κ_x and κ_y, 1/mm².

    The second Codazzi equation: cos θ·κ_y′ + tan θ·κ_y·(κ_x − κ_y); κ_y is that of the normal section here, not of a circle.
    Source: docs/derivations/compatible-pairs.md.
    """
    t, kappa_x, kappa_y, dkappa_y, _ = at
    return dkappa_y / np.hypot(1.0, t) + t * kappa_y * (kappa_x - kappa_y)


def compatibility_defect(at: Sections) -> Array:
    """δ = (cos θ·Ry)′ + tan θ = −Ry²·`twist_gradient`: 0 where a surface can hold both laws, no unit."""
    return -twist_gradient(at) / at.kappa_y**2


def circles_of_normal_curvature(profile: Profile, horizontal: PiecewiseChebyshev,
                                vertical: PiecewiseChebyshev) -> PiecewiseChebyshev:
    """κ_y/cos θ: the circles in x = const whose normal sections at y = 0 have the curvature κ_y (Meusnier), 1/mm."""
    breaks = np.union1d(horizontal.breaks, vertical.breaks)
    return approximate(lambda x: vertical(x) * np.hypot(1.0, profile.slope(x)), list(breaks))


def compatible_vertical(profile: Profile, horizontal: PiecewiseChebyshev, axis_depth_mm: float) -> PiecewiseChebyshev:
    """1/Ry of the only laws that go with Rx: Ry = (r0 − ∫tan θ dx)/cos θ = (r0 + z_p)/cos θ, 1/mm.

    axis_depth_mm : r0, the distance of the axis of revolution behind the origin.
    """

    def kappa(x: Array) -> Array:
        return 1.0 / ((axis_depth_mm + profile.height(x)) * np.hypot(1.0, profile.slope(x)))

    return approximate(kappa, list(horizontal.breaks))


def revolved(profile: Profile, axis_depth_mm: float, x: Array, y: Array) -> dict[str, Array]:
    """S_u … S_vv of the profile turned about the axis parallel to x, r0 behind it, at the points (x, y), each (n, 3).

    S(x, φ) = (x, r·sin φ, r·cos φ − r0) with r = r0 + z_p(x).
    """
    r, r_x, r_xx = axis_depth_mm + profile.height(x), profile.slope(x), profile.bend(x)
    sine = y / r
    cosine = np.sqrt((1.0 - sine) * (1.0 + sine))
    zero, one = np.zeros_like(x), np.ones_like(x)
    return {"u": np.stack([one, r_x * sine, r_x * cosine], axis=-1),
            "v": np.stack([zero, r * cosine, -r * sine], axis=-1),
            "uu": np.stack([zero, r_xx * sine, r_xx * cosine], axis=-1),
            "uv": np.stack([zero, r_x * cosine, -r_x * sine], axis=-1),
            "vv": np.stack([zero, -r * sine, -r * cosine], axis=-1)}


def shape_rms_percent(difference: ShapeOperator, designed: ShapeOperator, weights: Array) -> float:
    """RMS ‖difference‖ over RMS ‖designed‖, Frobenius, in percent: the contract's `shape_rms_percent`."""
    return 100.0 * _norm(difference, weights) / _norm(designed, weights)


def _norm(w: ShapeOperator, weights: Array) -> float:
    return float(np.sqrt(np.average(w.w11**2 + w.w22**2 + 2.0 * w.w12**2, weights=weights)))


def _minus(a: ShapeOperator, b: ShapeOperator) -> ShapeOperator:
    return ShapeOperator(a.w11 - b.w11, a.w22 - b.w22, a.w12 - b.w12)


def _rms(values: Array, weights: Array) -> float:
    return float(np.sqrt(np.average(values**2, weights=weights)))


# --- the tables ------------------------------------------------------------------------------------------------------


class Samples(NamedTuple):
    """The upper half of a mirror's grid, mm: the surfaces here are symmetric in y. A cell cut by y = 0 counts half."""

    x: Array
    y: Array
    weights: Array


class Evaluated(NamedTuple):
    """A designed mirror, its exact decoupled surface, and at its samples the sections, the design and what is realised."""

    mirror: Mirror
    sag: DecoupledSag
    samples: Samples
    at: Sections
    designed: ShapeOperator
    realised: ShapeOperator


def tables() -> tuple[Table, ...]:
    """The terms of the decoupled surface, its limits, compatible pairs and the level point, predicted and measured."""
    looked = [_look(mirror_cad.design(mirror_cad.load_spec(name))) for name in PRESETS]
    levelled = looked[PRESETS.index(LEVELLED)]
    return (_edge_places(looked), _remainders(looked), _defects(looked), _compatible_pairs(levelled), _levels(levelled))


def _look(mirror: Mirror) -> Evaluated:
    grid, laws = Grid.over(mirror.outline), mirror.curvature
    half_cell = 0.5 * float(grid.cells_y[1] - grid.cells_y[0])
    upper = grid.y > -0.5 * half_cell
    x, y = grid.x[upper], grid.y[upper]
    samples = Samples(x, y, grid.weights[upper] * np.where(y < 0.5 * half_cell, 0.5, 1.0))
    level = mirror.spec.horizontal.level_at
    left, right = mirror.box[:2]
    level_mm = {"left": left, "centre": 0.5 * (left + right), "right": right}[level] if isinstance(level, str) else level
    sag = DecoupledSag(_profile(laws.horizontal, level_mm), laws.vertical)
    return Evaluated(mirror, sag, samples, sections_at(sag.profile, laws.horizontal, laws.vertical, x), laws.shape(x),
                  shape_operator_of_sag(sag.derivatives(x, y)))


def _profile(horizontal: PiecewiseChebyshev, level_mm: float) -> Profile:
    return integrate_exactly(sine_of_tangent_angle(horizontal, level_mm), horizontal)


def _edge_middles_and_corners(looked: Evaluated) -> dict[str, tuple[float, float]]:
    """Samples on the outline to the full mm; the lower half is the mirror image of the upper one."""
    x, y = (values[looked.samples.weights == 0.0] for values in looked.samples[:2])  # the edge

    def farthest(reach: Array) -> tuple[float, float]:
        i = int(np.argmax(reach))
        return round(float(x[i])) + 0.0, round(float(y[i])) + 0.0

    half_width, half_height = float(np.abs(x).max()), float(y.max())
    return {"left edge": (float(x.min()), 0.0), "upper left corner": farthest(y / half_height - x / half_width),
            "upper edge": farthest(-np.where(y > 0.5 * half_height, np.abs(x), np.inf)),
            "upper right corner": farthest(y / half_height + x / half_width), "right edge": (float(x.max()), 0.0)}


def _edge_places(looked: list[Evaluated]) -> Table:
    rows: list[Row] = []
    for look in looked:
        mirror, laws, sag = look.mirror, look.mirror.curvature, look.sag
        for name, (x, y) in _edge_middles_and_corners(look).items():
            at_x, at_y = np.array([x]), np.array([y])
            predicted = leading_terms(sections_at(sag.profile, laws.horizontal, laws.vertical, at_x), at_y)
            realised = _minus(shape_operator_of_sag(sag.derivatives(at_x, at_y)), laws.shape(at_x))
            row: Row = {"mirror": mirror.spec.name, "place": name, "x": x, "y": y}
            for key in predicted._fields:
                row[f"{key}_predicted"] = _per_km(float(getattr(predicted, key)[0]))
                row[f"{key}_measured"] = _per_km(float(getattr(realised, key)[0]))
            rows.append(row)
    columns = [Column("mirror", "mirror"), Column("place", "place"), Column("x", "x, mm"), Column("y", "y, mm")]
    for key, title in TERMS.items():
        columns += [Column(f"{key}_predicted", f"{title} predicted, 1/km"), Column(f"{key}_measured", f"{title}, 1/km")]
    return Table(
        "model-places", "Deviation of the decoupled surface at its edge, predicted and measured",
        "The leading terms of docs/derivations/decoupled-surface.md beside the exact surface's own shape operator. "
        "1/km is 1e-6 per mm; a radius of 1250 mm is 800 per km.",
        tuple(columns), tuple(rows))


def _remainders(looked: list[Evaluated]) -> Table:
    rows: list[Row] = []
    for mirror, _, (x, y, weights), at, designed, realised in looked:
        predicted, closed = leading_terms(at, y), exact_shape(at, y)
        fitted = shape_operator(mirror.surface.derivatives(x, y))
        for key, title in TERMS.items():
            deviation = getattr(realised, key) - getattr(designed, key)
            rms = _rms(deviation, weights)
            left = {"leading": deviation - getattr(predicted, key), "closed": getattr(realised, key) - getattr(closed, key),
                    "fit": getattr(fitted, key) - getattr(closed, key)}
            rows.append({"mirror": mirror.spec.name, "term": title, "rms": PER_KM * rms,
                         "share": 100.0 * rms / _norm(designed, weights),
                         **{column: _or_rounding(100.0 * _rms(values, weights) / rms) for column, values in left.items()}})
    return Table(
        "model-remainder", "What the formulas leave unexplained",
        "RMS over the trimmed mirror of each part of the deviation, and how much of it the leading terms and the closed form "
        "leave on the exact surface. Last column: the closed form against the fitted B-spline, which is the fit's own error.",
        (Column("mirror", "mirror"), Column("term", "part"), Column("rms", "RMS, 1/km"),
         Column("share", "share of RMS ‖diag(1/Rx, 1/Ry)‖, %"), Column("leading", "left by the leading terms, %"),
         Column("closed", "left by the closed form, %", 1), Column("fit", "the same on the B-spline, %", 1)), tuple(rows))


def _defects(looked: list[Evaluated]) -> Table:
    rows: list[Row] = []
    for look in looked:
        mirror, sag, (x, y, weights), at, designed, realised = look
        profile, laws = sag.profile, mirror.curvature
        circles = circles_of_normal_curvature(profile, laws.horizontal, laws.vertical)
        corrected = shape_operator_of_sag(DecoupledSag(profile, circles).derivatives(x, y))
        none = np.zeros_like(x)
        twist = ShapeOperator(none, none, y * twist_gradient(at))
        k1, k2 = _percent_of_principal(look)
        rows.append({
            "mirror": mirror.spec.name,
            "defect": round(float(np.abs(compatibility_defect(at)).max()), LAST_FIGURE_OF_RATIOS),
            "twist": round(100.0 * float(np.abs(twist.w12 / designed.w22).max()), LAST_FIGURE_OF_RATIOS),
            "decoupled": shape_rms_percent(_minus(realised, designed), designed, weights), "k1": k1, "k2": k2,
            "corrected": _or_rounding(shape_rms_percent(_minus(corrected, designed), designed, weights)),
            "corrected_predicted": _or_rounding(shape_rms_percent(twist, designed, weights))})
    return Table(
        "model-defect", "How far a pair of laws is from what one surface can hold",
        "The defect δ = (cos θ·Ry)′ + tan θ of each design, the twist y·δ/Ry² that every surface with these curvatures along "
        "y = 0 begins with, and the shape deviation of two constructions: circles of radius Ry (ours), and of cos θ·Ry.",
        (Column("mirror", "mirror"), Column("defect", "largest size of δ"),
         Column("twist", "largest twist y·δ/Ry², % of 1/Ry"), Column("decoupled", "circles Ry: shape RMS, %"),
         Column("k1", "k1, largest, %"), Column("k2", "k2, largest, %"),
         Column("corrected", "circles cos θ·Ry: shape RMS, %"),
         Column("corrected_predicted", "predicted by δ alone, %")), tuple(rows))


def _compatible_pairs(levelled: Evaluated) -> Table:
    span = laws.Span(*SHEET[:2])
    torus, sphere = (laws.Constant(radius_mm=radius).over(span).series(*SHEET[:2]) for radius in (400.0, 950.0))
    rows = tuple(_compatible_pair(levelled.samples, *pair) for pair in (
        (f"Rx of {LEVELLED}, r0 = 1250 mm", levelled.mirror.curvature.horizontal, 1250.0),
        ("torus: Rx = 400 mm, r0 = 1250 mm", torus, 1250.0),
        ("sphere: Rx = r0 = 950 mm", sphere, 950.0)))
    return Table(
        "model-compatible", "Pairs that one surface holds exactly, and the decoupled surface of the same pair",
        "Ry = (r0 + z_p)/cos θ from Rx. Shape RMS against the pair of the surface of revolution, evaluated exactly and as a "
        "fitted B-spline, and of the decoupled surface, whose circles have the radius Ry, beside what its leading terms say.",
        (Column("pair", "pair"), Column("left", "Ry left, mm", 5), Column("centre", "Ry centre, mm", 5),
         Column("right", "Ry right, mm", 5), Column("revolved", "revolved, exact, %", 1),
         Column("fitted", "revolved, B-spline, %", 1), Column("decoupled", "decoupled, %"),
         Column("predicted", "decoupled, predicted, %")), rows)


def _compatible_pair(samples: Samples, title: str, horizontal: PiecewiseChebyshev, axis_depth_mm: float) -> Row:
    x, y, weights = samples
    profile = _profile(horizontal, 0.0)
    vertical = compatible_vertical(profile, horizontal, axis_depth_mm)
    at = sections_at(profile, horizontal, vertical, x)
    designed = ShapeOperator(at.kappa_x, at.kappa_y, np.zeros_like(x))
    realised = {
        "revolved": shape_operator(revolved(profile, axis_depth_mm, x, y)),
        "fitted": shape_operator(_fitted(profile, horizontal, vertical, samples).derivatives(x, y)),
        "decoupled": shape_operator_of_sag(DecoupledSag(profile, vertical).derivatives(x, y))}
    return {"pair": title, "left": 1.0 / float(vertical(x.min())), "centre": 1.0 / float(vertical(0.0)),
            "right": 1.0 / float(vertical(x.max())),
            "predicted": shape_rms_percent(leading_terms(at, y), designed, weights),
            **{key: _or_rounding(shape_rms_percent(_minus(w, designed), designed, weights)) for key, w in realised.items()}}


def _fitted(profile: Profile, horizontal: PiecewiseChebyshev, vertical: PiecewiseChebyshev, samples: Samples) -> BSplineSurface:
    """The surface of revolution as B-spline: it is the decoupled one of the radii cos θ·Ry, whose circles share an axis."""
    sag = DecoupledSag(profile, circles_of_normal_curvature(profile, horizontal, vertical))
    breaks = tuple((float(x), 3) for x in horizontal.breaks[1:-1])  # κ_x has one continuous derivative there, z three
    half_height = float(samples.y.max())
    task = FitTask(sag, SHEET, (float(samples.x.min()), float(samples.x.max()), -half_height, half_height), breaks,
                   lambda x: np.stack([horizontal(x), vertical(x)], axis=-1), FIT_MM, FIT_PERCENT)
    return fit_by_collocation(task, "auto", "auto").surface


def _levels(levelled: Evaluated) -> Table:
    spec, matched = levelled.mirror.spec, levelled.mirror.matched
    # The law is held, not solved anew: only the level point differs between the rows.
    held = spec.horizontal.model_dump(exclude={"match"}) | dict([matched] if matched else [])
    rows: list[Row] = []
    for level in LEVELS:
        horizontal = type(spec.horizontal).model_validate(held | {"level_at": level})
        look = _look(mirror_cad.design(spec.model_copy(update={"horizontal": horizontal})))
        mirror, sag, (_, y, weights), at, designed, realised = look
        predicted = leading_terms(at, y)
        k1, k2 = _percent_of_principal(look)
        across, upright = np.degrees(mirror.section_fields_of_view())
        left, right = np.degrees(sag.profile.tangent_angle(np.array(mirror.box[:2])))
        rows.append({
            "level": level if isinstance(level, str) else f"{level:g} mm".replace("-", "−"),
            "left": round(float(left), LAST_FIGURE_OF_RATIOS) + 0.0, "right": round(float(right), LAST_FIGURE_OF_RATIOS) + 0.0,
            "axis": _rms(at.slope - at.dkappa_y / at.kappa_y**2, weights),
            "shape": shape_rms_percent(_minus(realised, designed), designed, weights),
            "shape_predicted": shape_rms_percent(predicted, designed, weights),
            "ky": 100.0 * _rms((realised.w22 - designed.w22) / designed.w22, weights),
            "ky_predicted": 100.0 * _rms(predicted.w22 / designed.w22, weights),
            "k1": k1, "k2": k2, "h_fov": float(across), "v_fov": float(upright)})
    return Table(
        "model-level", f"Where the profile is level: {LEVELLED}",
        "The same two laws (what was matched at the centre is held) with θ = 0 at five points. Predicted: the leading terms. "
        "The fields of view are those of the sections.",
        (Column("level", "level_at"), Column("left", "θ left, °"), Column("right", "θ right, °"),
         Column("axis", "RMS of Ry′ + tan θ"), Column("shape", "shape RMS, %"),
         Column("shape_predicted", "shape RMS predicted, %"), Column("ky", "ky RMS, %"),
         Column("ky_predicted", "ky RMS predicted, %"), Column("k1", "k1, largest, %"), Column("k2", "k2, largest, %"),
         Column("h_fov", "H-FOV, °", 4), Column("v_fov", "V-FOV, °", 4)), tuple(rows))


def _percent_of_principal(look: Evaluated) -> tuple[float, float]:
    """The largest deviation of k1 and of k2, signed, in percent of the designed value."""
    after, before = principal_curvatures_of(look.realised), principal_curvatures_of(look.designed)
    k1, k2 = (100.0 * (a / b - 1.0) for a, b in zip(after, before, strict=True))
    return float(k1[np.argmax(np.abs(k1))]), float(k2[np.argmax(np.abs(k2))])


def _per_km(value: float) -> float:
    return LAST_FIGURE_PER_KM * round(PER_KM * value / LAST_FIGURE_PER_KM) + 0.0  # no −0


def _or_rounding(percent: float) -> float | str:
    return f"below {ROUNDING_PERCENT:g}".replace("e-0", "e-") if percent < ROUNDING_PERCENT else percent
