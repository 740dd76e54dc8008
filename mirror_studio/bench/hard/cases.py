"""Every hard case by its name, each hard for one reason."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from mirror_cad.errors import MirrorError, OutlineError, ProfileError, SolidError, SpecError
from mirror_studio.bench.hard.case import Case, Figure, Refusal
from mirror_studio.bench.hard.chain import make
from mirror_studio.bench.hard.figures import THICKNESS
from mirror_studio.bench.hard.runs import decoupled, euler, faithful, faithful_exact, far_away, million_points
from mirror_studio.bench.hard.sheets import Array, Decoupled, Law, Sphere
from mirror_studio.bench.hard.specs import (
    FLAT,
    SPIKE,
    SQUARE,
    STAR,
    ZONES,
    ZONES_BREAKS,
    ZONES_LAW,
    Spec,
    constant,
    kappa,
    linear,
    noisy,
    polygon,
    rectangle,
    scaled,
    spec,
    t_of,
    table,
    zones,
    zones_law,
)

c = constant  # a letter, for it stands in nearly every line


def _made(name: str, hard: str, horizontal: Spec, vertical: Spec, across: Law | None = None, upright: Law | None = None,
          sections: dict[str, Spec] | None = None, **options: Any) -> Case:
    """A case that has to come out; the laws of constant radii are read off the specification."""
    across = 1.0 / horizontal["radius_mm"] if across is None else across
    upright = 1.0 / vertical["radius_mm"] if upright is None else upright
    return Case(name, hard, partial(decoupled, raw=spec(horizontal, vertical, **(sections or {})), across=across,
                                    upright=upright, **options))


def _refused(name: str, hard: str, horizontal: Spec, vertical: Spec, kind: type[MirrorError], *words: str,
             sections: dict[str, Spec] | None = None) -> Case:
    def run(folder: Path) -> Sequence[Figure]:
        make(folder, spec(horizontal, vertical, **(sections or {})))
        return ()

    return Case(name, hard, run, Refusal(kind, words))


def _with_outline(case: Case, points: Array) -> Case:
    """The case in a folder that holds outline.dxf with the closed polyline through points (n, 2), written by ezdxf."""

    def run(folder: Path) -> Sequence[Figure]:
        import ezdxf

        document = ezdxf.new("R2010", units=4)
        document.modelspace().add_lwpolyline([(float(x), float(y)) for x, y in points], close=True)
        document.saveas(folder / "outline.dxf")
        return case.run(folder)

    return replace(case, run=run)


@cache
def cases() -> dict[str, Case]:
    """Every case by its name."""
    found = [*_flat_and_signs(), *_laws(), *_tables(), *_steep(), *_sizes(), *_places_and_outlines(), *_plates(),
             *_numerics(), *_faithful(), *_impossible()]
    return {case.name: case for case in found}


def case_named(name: str) -> Case:
    """The case of that name."""
    return cases()[name]


def _flat_and_signs() -> list[Case]:
    return [
        _made("plane", "no curvature: no percent, no radius", c(FLAT), c(FLAT), traced=True),
        _made("nearly plane", "radii of 1e9 mm, of either sign: sags of 1e-5 mm", c(1e9), c(-1e9)),
        _made("curvature 1e-300", "squares and percent underflow", kappa("1e-300"), kappa("-1e-300"), 1e-300, -1e-300),
        _made("radius 1e300", "1/R² underflows", c(1e300), c(1250.0)),
        _made("concave", "both radii negative", c(-2000.0), c(-1500.0), traced=True),
        _made("concave zones", "a progressive law of negative radii", zones(-1250.0, -400.0, 0.5, 1.0), c(-1250.0),
              zones_law(-1250.0, -400.0, 0.5, 1.0), breaks=ZONES_BREAKS),
        _made("saddle", "convex across, concave upright", c(1250.0), c(-1500.0), traced=True),
        _made("sign-changing law", "curvature through 0, where percent of it have no meaning", kappa("0.001*sin(x/40)"),
              c(1250.0), lambda x: 0.001 * np.sin(x / 40.0), traced=True),
        _made("sign-changing both ways", "flat in all directions along one line", kappa("x*1e-5"), kappa("x*2e-5"),
              lambda x: 1e-5 * x, lambda x: 2e-5 * x),
        _made("cylinder, upright straight", "one principal curvature 0 everywhere", c(1250.0), c(FLAT), traced=True),
        _made("cylinder, straight across", "one principal curvature 0 everywhere", c(FLAT), c(1250.0), traced=True),
        _made("progressive, upright straight", "straight rulings under a changing radius", ZONES, c(FLAT), ZONES_LAW,
              breaks=ZONES_BREAKS),
        _made("umbilic line inside", "Rx crosses Ry: the principal directions swap", linear(1250.0, 600.0), c(900.0),
              lambda x: 1.0 / (1250.0 - 650.0 * t_of(x)), traced=True),
        _made("umbilic everywhere", "equal radii: no principal directions", c(950.0), c(950.0), traced=True),
    ]


def _laws() -> list[Case]:
    def step(width: float) -> Callable[[Array], Array]:
        return lambda x: 0.0008 + 0.0008 * np.clip((x - 10.0) / width, 0.0, 1.0)

    return [
        _made("jump, not announced", "κ doubles within 1e-6 mm inside a formula",
              kappa("0.0008 + 0.0008*max(0, min(1, (x - 10)*1e6))"), c(1250.0), step(1e-6), breaks=(10.0, 10.000001)),
        _made("jump, by zones", "κ triples within 2e-5 mm", zones(1250.0, 400.0, 0.5, 0.5 + 1e-7), c(1250.0),
              zones_law(1250.0, 400.0, 0.5, 0.5 + 1e-7), breaks=(0.0, -2.3e-5)),
        _made("kink, not announced", "κ′ jumps inside a formula", kappa("0.0008 + max(0, 0.00001*(x - 10))"), c(1250.0),
              lambda x: 0.0008 + np.maximum(0.0, 1e-5 * (x - 10.0)), breaks=(10.0,)),
        _made("transition 0.1 mm wide", "κ triples within 0.1 mm", zones(1250.0, 400.0, 0.5, 0.5 + 0.1 / 230.0), c(1250.0),
              zones_law(1250.0, 400.0, 0.5, 0.5 + 0.1 / 230.0), breaks=(0.0, -0.1), traced=True),
        _made("tanh 0.1 mm wide", "the same without an end: no break to put a knot at",
              kappa("0.0012 + 0.0004*tanh((x - 20)/0.05)"), c(1250.0),
              lambda x: 0.0012 + 0.0004 * np.tanh((x - 20.0) / 0.05), breaks=(20.0,)),
        _made("kink upright", "Ry's kink is a crease in the surface", c(1250.0), zones(1250.0, 900.0, 0.3, 0.7),
              upright=zones_law(1250.0, 900.0, 0.3, 0.7), breaks=(46.0, -46.0)),
        _refused("jump upright", "where Ry jumps the circles do not meet: a step of millimetres", c(1250.0),
                 zones(1250.0, 900.0, 0.5, 0.5 + 1e-7), MirrorError, "vertical"),
        _made("power law, exponent 0.02", "R falls by half within 1e-13 mm of the edge",
              {"law": "power", "right_mm": 1250.0, "left_mm": 800.0, "exponent": 0.02}, c(1250.0),
              lambda x: 1.0 / (1250.0 - 450.0 * np.clip(t_of(x), 0.0, 1.0) ** 0.02), percent=0.1,
              reason="no span resolves the last 0.1 mm: the report has to say so", met=False),
        _made("power law, exponent 50", "all change in the last millimetres",
              {"law": "power", "right_mm": 1250.0, "left_mm": 400.0, "exponent": 50.0}, c(1250.0),
              lambda x: 1.0 / (1250.0 - 850.0 * t_of(x) ** 50)),
        _made("law's span inside the mirror", "kinks at ±40 mm, where the law is held from",
              linear(1250.0, 600.0) | {"span_mm": [-40.0, 40.0]}, c(1250.0),
              lambda x: 1.0 / (1250.0 - 650.0 * np.clip((40.0 - x) / 80.0, 0.0, 1.0)), breaks=(-40.0, 40.0)),
        _made("law's span beside the mirror", "the law is held at one value all over it",
              linear(1250.0, 600.0) | {"span_mm": [200.0, 300.0]}, c(1250.0), 1.0 / 600.0),
        _made("law's span 20 m wide", "the mirror sees a hundredth of the law",
              linear(1250.0, 600.0) | {"span_mm": [-10_000.0, 10_000.0]}, c(1250.0),
              lambda x: 1.0 / (1250.0 - 650.0 * (1e4 - x) / 2e4)),
        _made("level at the edge", "slopes of one sign only, to 12°", c(1250.0) | {"level_at": "right"}, c(1250.0),
              level_mm=115.0, traced=True),
        _made("level outside the mirror", "nowhere level", c(1250.0) | {"level_at": -125.0}, c(1250.0), level_mm=-125.0),
        _made("waves of 20 mm", "κ between 0 and 0.002, 12 times", kappa("0.001*(1 + sin(x/3))"), c(1250.0),
              lambda x: 0.001 * (1.0 + np.sin(x / 3.0))),
        _made("waves of 0.5 mm", "460 waves, more than spans are allowed: the sag can hold, the curvature cannot",
              kappa("0.001*(1 + 0.5*sin(4*pi*x))"), c(1250.0), lambda x: 0.001 * (1.0 + 0.5 * np.sin(4.0 * np.pi * x)),
              percent=150.0, position_mm=1e-4, met=False,
              reason="the waves are ±100 % of κ where it is lowest; the report has to say missed"),
        _made("hole in a formula", "0/0 at one point", kappa("0.001*(x - 20)/(x - 20)"), c(1250.0), 0.001),
        _made("vertical radius falling from 1250 to 200 mm", "beside the mirror the circles would be lower than it", c(1250.0),
              linear(1250.0, 200.0), upright=lambda x: 1.0 / (1250.0 - 1050.0 * t_of(x)), breaks=(-115.0,)),
    ]


def _tables() -> list[Case]:
    x = np.arange(-115.0, 116.0)
    one, one_law = noisy(0.01)
    small, small_law = noisy(1e-4)
    digits, digits_law = table(x, np.array([float(f"{1000.0 + 200.0 * math.sin(at / 50.0):.6g}") for at in x]))
    two, two_law = {"law": "table", "x_mm": [-115.0, 115.0], "radius_mm": [400.0, 1250.0]}, \
        lambda x: 1.0 / 1250.0 + (1.0 / 400.0 - 1.0 / 1250.0) * t_of(x)
    fine = np.linspace(-115.0, 115.0, 100_000)
    many, _ = table(fine, 1000.0 + 200.0 * np.sin(fine / 50.0))
    far = {"law": "table", "x_mm": [20_000.0, 20_100.0], "radius_mm": [800.0, 1250.0]}
    near = {"law": "table", "x_mm": [-115.0, 0.0, 1e-7, 115.0], "radius_mm": [1000.0, 1000.0, 1001.0, 1001.0]}
    return [
        _made("table with 1 % noise", "231 rows, each 1 % off at random", one, c(1250.0), one_law, traced=True),
        _made("table with 0.01 % noise", "231 rows, each 0.01 % off at random", small, c(1250.0), small_law),
        _made("vertical table with 0.01 % noise", "Ry's second derivative counts y²/2 times: each row is a crease", c(1250.0),
              small, upright=small_law, breaks=tuple(x)),
        _made("table to six digits", "231 rows, radii rounded", digits, c(1250.0), digits_law),
        _made("table of two rows", "a law linear in κ", two, c(1250.0), two_law),
        _made("table of 100,000 rows", "a row every 2 µm", many, c(1250.0),
              lambda x: 1.0 / (1000.0 + 200.0 * np.sin(x / 50.0))),
        _made("table 20 m away", "held at its first value over the whole mirror", far, c(1250.0), 1.0 / 800.0),
        _refused("table with rows 1e-7 mm apart", "the spline swings by its slope, 1e7 times the step", near, c(1250.0),
                 MirrorError, "table"),
    ]


def _steep() -> list[Case]:
    radius = 115.0 / math.sin(math.radians(80.0))
    past_80: dict[str, Any] = {"percent": 50.0, "position_mm": 0.05, "met": False,
                               "reason": "what 400 spans come to past 80°; the report has to call it missed"}
    return [
        _made("slope to 80°", "at the left and right edge", c(radius), c(1250.0)),
        _made("slope to 80° upright", "at the upper and lower edge", c(1250.0), c(170.0 / math.sin(math.radians(80.0))),
              sections=rectangle(230.0, 340.0)),
        _made("slope to 89°", "at the left and right edge, where z″ is 190,000 times κ",
              c(115.0 / math.sin(math.radians(89.0))), c(1250.0), **past_80),
        _made("slope to 80° at a corner of two 70°", "both ways at once", c(115.0 / math.sin(math.radians(70.0))),
              c(170.0 / math.sin(math.radians(70.0))), sections=rectangle(230.0, 340.0)),
        _made("concave slope to 80°", "the edge leans over what it reflects", c(-radius), c(-1250.0)),
        _made("concave, vertical radius just above the half-height", "−171 mm over 170", c(-1250.0), c(-171.0),
              sections=rectangle(230.0, 340.0)),
        _refused("slope past vertical", "∫κ dx reaches 1 at 105 mm of 115", c(105.0), c(1250.0), ProfileError,
                 "turns vertical at x = ", "-115.0 mm"),
        _refused("slope vertical at the edge", "∫κ dx = 1 exactly there", c(115.0), c(1250.0), ProfileError, "vertical"),
        _made("vertical radius just above the half-height", "171 mm over 170: 84°", c(1250.0), c(171.0),
              sections=rectangle(230.0, 340.0)),
        _made("vertical radius 0.03 mm above the half-height", "88.9° at the upper edge", c(1250.0), c(170.03),
              sections=rectangle(230.0, 340.0), **past_80),
        _refused("vertical radius just below the half-height", "its circle ends before the edge", c(1250.0), c(169.9),
                 ProfileError, "169.9", "half-height 170", sections=rectangle(230.0, 340.0)),
    ]


def _sizes() -> list[Case]:
    return [
        _made("20 mm wide, radii scaled", "everything at 1:11.5", c(1250.0 * 20 / 230), c(900.0 * 20 / 230),
              sections=scaled(20.0), traced=True),
        _made("20 mm wide, radii as they are", "sags of micrometres", c(1250.0), c(900.0), sections=scaled(20.0)),
        _made("3 m wide, radii scaled", "everything at 13:1", c(1250.0 * 3000 / 230), c(900.0 * 3000 / 230),
              sections=scaled(3000.0), traced=True),
        _refused("3 m wide, radii as they are", "the profile turns vertical inside", c(1250.0), c(4000.0), ProfileError,
                 "turns vertical at x = ", sections=scaled(3000.0)),
        _made("1.5 mm wide", "next to the smallest outline", c(1250.0), c(900.0), sections=scaled(1.5)),
        _refused("0.5 mm wide", "below the smallest outline", c(1250.0), c(900.0), OutlineError, "0.5 mm wide",
                 sections=scaled(0.5)),
        _made("strip of 230 × 3 mm", "76 times as wide as high", c(1250.0), c(900.0), sections=rectangle(230.0, 3.0, 1.0)),
        _made("strip of 3 × 340 mm", "113 times as high as wide", c(1250.0), c(900.0), sections=rectangle(3.0, 340.0, 1.0)),
        _made("30 m wide, sags of a metre", "coordinates of 15,000 mm, still to 1e-5", c(1e5), c(1e5),
              sections=rectangle(30_000.0, 30_000.0, 100.0) | {"export": {"stl_deflection_mm": 1.0}}),
        _refused("90 m wide, STL within 0.01 mm", "STL's 24 bits end at 0.006 mm there", c(FLAT), c(FLAT), MirrorError,
                 "deflection of 0.01 mm", "STL rounds", sections=rectangle(90_000.0, 90_000.0, 100.0)),
        _made("blank of 2 m around a small mirror", "the sheet is eight times as wide as what is judged", c(1250.0), c(1250.0),
              sections={"blank": {"width_mm": 2000.0, "height_mm": 2000.0}}),
        _made("margin of 1 m", "the sheet has to stop where it is steeper than 80°", c(400.0), c(400.0),
              sections={"export": {"surface_margin_mm": 1000.0}}),
        _made("margin 0", "rays at the very end of the sheet", c(1250.0), c(900.0), traced=True, sections=rectangle(
            230.0, 340.0) | {"blank": {"width_mm": 230.0, "height_mm": 340.0}, "export": {"surface_margin_mm": 0.0}}),
    ]


def _places_and_outlines() -> list[Case]:
    file = {"outline": {"file": "outline.dxf"}}

    def drawn(name: str, hard: str, points: Array, **options: Any) -> Case:
        return _with_outline(_made(name, hard, c(1250.0), c(900.0), sections=file, **options), points)

    away = np.array([20_000.0, 800.0])
    return [
        Case("origin 20 m away", "vehicle coordinates: moved by build123d to (20000, 800, −1000) mm and turned", far_away),
        _with_outline(_refused("outline file 20 m away", "an outline is in mirror coordinates", c(1250.0), c(900.0),
                               OutlineError, "beyond the blank", "20080.0", sections=file), SQUARE + away),
        Case("a million points", "time and memory of evaluation", million_points),
        _made("outline touches the blank", "no glass left beside the outline", c(1250.0), c(900.0), sections={
            "blank": {"width_mm": 230.0, "height_mm": 340.0}}),
        _made("corners of 0.1 mm", "arcs a thousandth of the sides", c(1250.0), c(900.0),
              sections={"outline": {"corner_radius_mm": 0.1}}),
        _made("sharp corners", "no arcs", c(1250.0), c(900.0), sections={"outline": {"corner_radius_mm": 0.0}}),
        _made("corner arcs that meet", "sides of no length", c(1250.0), c(900.0), sections=rectangle(230.0, 230.0, 115.0)),
        drawn("outline of 1,000 vertices", "a plate of 1,002 faces", polygon(1000)),
        drawn("star", "an outline that is not convex", STAR),
        drawn("an edge of 0.7 µm", "shorter than the gaps that are closed: its ends become one", SPIKE, level_mm=0.000125),
        _with_outline(_refused("outline that crosses itself", "a bow tie", c(1250.0), c(900.0), OutlineError,
                               "crosses or touches itself", "(0, 0) mm", sections=file), SQUARE[[0, 2, 1, 3]]),
        drawn("origin 1 mm inside the edge", "the mirror hangs to one side", np.array(
            [(-1.0, -80.0), (120.0, -80.0), (120.0, 80.0), (-1.0, 80.0)]), level_mm=59.5),
    ]


def _plates() -> list[Case]:
    laws = (ZONES, c(1250.0))

    def glass(t: float) -> dict[str, Spec]:
        return {"glass": {"thickness_mm": t}}

    return [
        _made("plate of 0.05 mm", "front and back 50 µm apart", *laws, ZONES_LAW, breaks=ZONES_BREAKS, sections=glass(0.05),
              shown=THICKNESS),
        _made("plate of 60 mm", "a seventh of the smallest radius", *laws, ZONES_LAW, breaks=ZONES_BREAKS,
              sections=glass(60.0), shown=THICKNESS),
        _made("plate of 1 m", "four fifths of the radius: the back is a fifth as wide", c(1250.0), c(1250.0),
              sections=glass(1000.0), shown=THICKNESS),
        _refused("plate of 1 nm", "front and back are one to any reader", *laws, SolidError, "glass.thickness_mm = 1e-06",
                 sections=glass(1e-6)),
        _made("concave plate of 60 mm", "the back is larger than the front", c(-400.0), c(-500.0), sections=glass(60.0),
              shown=THICKNESS),
        _refused("thicker than the smallest convex radius", "the back would fold", *laws, SolidError,
                 "glass.thickness_mm = 450", "smallest convex radius", "400", sections=glass(450.0)),
        _refused("thicker than the smallest concave radius", "a plate deeper than its own radius", c(-400.0), c(-500.0),
                 SolidError, "glass.thickness_mm = 450", "concave radius", sections=glass(450.0)),
    ]


def _numerics() -> list[Case]:
    kernel: dict[str, Any] = {"percent": 0.2, "position_mm": 1e-4, "met": False, "breaks": ZONES_BREAKS,
                              "reason": "no knot stands where the law breaks; the report has to call it missed"}
    return [
        _made("degree 9, one span", "ten coefficients a direction are all there is", c(1250.0), c(1250.0),
              sections={"surface": {"degree": 9, "spans": [1, 1]}}),
        _made("degree 3, one span", "a cubic cannot be a circle to 1e-5 mm, and the report has to say so", c(1250.0), c(1250.0),
              sections={"surface": {"degree": 3, "spans": [1, 1]}}, percent=10.0, position_mm=0.05,
              reason="the quartic term of a circle, x⁴/8R³, over a span of 250 mm", met=False),
        _made("200 × 60 spans", "12,000 patches, each rounding", c(1250.0), c(900.0),
              sections={"surface": {"degree": 5, "spans": [200, 60]}}),
        _made("tolerances at their lowest", "1e-9 mm and 1e-6 %: below the rounding of curvature", c(1250.0), c(900.0),
              sections={"surface": {"position_tolerance_mm": 1e-9, "curvature_tolerance_percent": 1e-6}}, percent=1e-6,
              position_mm=1e-9),
        _made("tolerances at their highest", "1 mm and 100 %: almost any surface is good enough", ZONES, c(1250.0), ZONES_LAW,
              breaks=ZONES_BREAKS, sections={"surface": {"position_tolerance_mm": 1.0, "curvature_tolerance_percent": 100.0}},
              percent=100.0, position_mm=1.0),
        _made("the kernel's interpolation", "it takes no word on errors, and has failed with every node hit", ZONES, c(1250.0),
              ZONES_LAW, sections={"surface": {"fit": "occt-interpolate"}}, **kernel),
        _made("the kernel's approximation", "a tolerance for points, none for curvature", ZONES, c(1250.0), ZONES_LAW,
              sections={"surface": {"fit": "occt-approximate"}}, **kernel),
        Case("Euler, h = 10 mm", "26 steps of first order across the mirror", euler),
        _made("Euler, h = 0.001 mm", "260,000 steps, each a rounding of z that z″ divides by h²", c(1250.0), c(900.0),
              sections={"surface": {"integration": "euler", "step_mm": 0.001}}, position_mm=1e-4,
              reason="first order: h·θ/2 over half the width; the report has to call it missed", met=False),
        _made("STL within 1 µm", "a hundred thousand facets", c(1250.0), c(900.0),
              sections={"export": {"stl_deflection_mm": 0.001}}, shown="STL facets"),
        _made("STL within 10 mm", "the deflection is as large as the sag", c(1250.0), c(900.0),
              sections={"export": {"stl_deflection_mm": 10.0}}, shown="STL facets"),
    ]


def _faithful() -> list[Case]:
    surface = {"surface": {"method": "faithful"}}

    def ball(name: str, hard: str, radius: float, sections: dict[str, Spec] | None = None) -> Case:
        raw = spec(c(radius), c(radius), **surface, **(sections or {}))
        return Case(f"faithful: {name}", hard, partial(faithful_exact, raw=raw, sheet=Sphere(radius)))

    def other(name: str, hard: str, law: Spec, across: Law, breaks: tuple[float, ...] = ()) -> Case:
        return Case(f"faithful: {name}", hard, partial(faithful, raw=spec(law, c(1250.0), **surface), across=across,
                                                       upright=1.0 / 1250.0, breaks=breaks))

    return [
        ball("sphere", "umbilic everywhere, and a closed form to be found by least squares", 950.0),
        ball("plane", "nothing to weigh by", FLAT),
        ball("concave sphere", "negative radii", -2000.0),
        ball("sphere 20 mm wide", "sags of micrometres", 1250.0, scaled(20.0)),
        ball("sphere 3 m wide", "sags of decimetres", 1250.0 * 3000 / 230, scaled(3000.0)),
        Case("faithful: cylinder", "one law flat", partial(faithful_exact, raw=spec(c(1250.0), c(FLAT), **surface),
                                                           sheet=Decoupled(1.0 / 1250.0, 0.0, 0.0, (), -115.0, 115.0))),
        other("progressive", "the paper's mirror", ZONES, ZONES_LAW, breaks=ZONES_BREAKS),
        other("sign-changing law", "curvature through 0", kappa("0.001*sin(x/40)"), lambda x: 0.001 * np.sin(x / 40.0)),
        other("jump in the law", "no smooth surface has it", kappa("0.0008 + 0.0008*max(0, min(1, (x - 10)*1e6))"),
              lambda x: 0.0008 + 0.0008 * np.clip((x - 10.0) * 1e6, 0.0, 1.0), breaks=(10.0,)),
    ]


def _impossible() -> list[Case]:
    return [
        _refused("formula with a pole", "κ → ∞ at 20 mm", kappa("0.001/(x - 20)"), c(1250.0), SpecError, "per mm at x = 2",
                 "radius below 1 mm"),
        _refused("formula that overflows", "exp(1000·x)", kappa("exp(1000*x)"), c(1250.0), SpecError,
                 "exp(1000*x)", "not finite at x ="),
        _refused("root of the negative", "half the mirror has no law", kappa("0.001*sqrt(x)"), c(1250.0), SpecError,
                 "not finite", "x ="),
        _refused("power of powers", "9**9**9 is no float", kappa("9**9**9"), c(1250.0), SpecError, "9**9**9"),
        _refused("law rougher than numbers", "a wave every 6e-6 mm", kappa("0.001*(1 + sin(1e6*x))"), c(1250.0),
                 MirrorError, "rough", "x ="),
        _refused("radius of 0.5 mm", "no mirror", c(0.5), c(1250.0), SpecError,
                 "horizontal.radius_mm = 0.5", "at least 1 mm in size"),
        _refused("radius 0", "no curvature at all", c(0.0), c(1250.0), SpecError, "horizontal.radius_mm = 0"),
        _refused("radius NaN", "not a number", c(math.nan), c(1250.0), SpecError, "horizontal.radius_mm = nan"),
        _refused("table with a NaN", "not a number in row 2",
                 {"law": "table", "x_mm": [0.0, 5.0], "curvature_per_mm": [0.001, math.nan]}, c(1250.0), SpecError,
                 "horizontal.curvature_per_mm"),
        _refused("table that turns back", "two rows at one point",
                 {"law": "table", "x_mm": [0.0, 5.0, 5.0], "radius_mm": [900.0, 900.0, 800.0]}, c(1250.0), SpecError,
                 "must rise", "row 3"),
        _refused("radius through infinity", "linear from 900 to −900 mm passes 0", linear(900.0, -900.0), c(1250.0), SpecError,
                 "opposite signs"),
        _refused("match out of reach", "no exponent gives 120°",
                 {"law": "power", "right_mm": 1250.0, "left_mm": 400.0, "exponent": "match", "match": {"h_fov_deg": 120.0}},
                 c(1250.0), SpecError, "120.00°", "reaches"),
        _refused("level outside the blank", "125 mm is its half-width", c(1250.0) | {"level_at": 126.0}, c(1250.0), SpecError,
                 "horizontal.level_at = 126", "125"),
        _refused("wider than the blank", "260 of 250 mm", c(1250.0), c(1250.0), SpecError, "outline.width_mm = 260", "250",
                 sections={"outline": {"width_mm": 260.0}}),
        _refused("corner radius that does not fit", "150 mm on sides of 230", c(1250.0), c(1250.0), OutlineError,
                 "corner_radius_mm 150", "largest radius that fits", sections={"outline": {"corner_radius_mm": 150.0}}),
        _refused("march of millions of steps", "0.001 mm over 3 m", c(16_000.0), c(16_000.0), ProfileError, "step_mm",
                 "steps", sections=scaled(3000.0) | {"surface": {"integration": "rk4", "step_mm": 0.001}}),
        _refused("march of three steps", "100 mm over 260", c(1250.0), c(1250.0), ProfileError, "step_mm = 100", "3 steps",
                 sections={"surface": {"integration": "euler", "step_mm": 100.0}}),
    ]
