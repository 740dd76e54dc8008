"""What holds for any law: the fit within its tolerances, rigid motion, scale, the STEP file; and the closed forms."""

from __future__ import annotations

import itertools
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

import mirror_cad
from mirror_cad.deviation import against_design
from mirror_cad.errors import ProfileError
from mirror_cad.mirror import Mirror
from mirror_cad.occt.step import read_step
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.differential import (
    principal_curvatures,
    principal_curvatures_of,
    shape_operator,
    shape_operator_of_sag,
)
from tests.conftest import constant, designed, spec_of

# Radii down to half again the mirror's half-height, of either sign, to nearly flat.
SIZES = st.floats(260.0, 20_000.0)
SIGNS = st.sampled_from([1.0, -1.0])
# A failing design takes a second: shrinking one would take many minutes, and the first found says enough.
UNSHRUNK = (Phase.explicit, Phase.reuse, Phase.generate)
TABLES = st.lists(st.floats(-0.003, 0.003), min_size=2, max_size=9)


@st.composite
def laws(draw: st.DrawFn) -> dict[str, Any]:
    """Any law of the specification, convex, concave, flat or changing sign."""
    kind = draw(st.sampled_from(["constant", "flat", "linear", "power", "zones", "table", "waves", "kink"]))
    sign = draw(SIGNS)
    right, left = sign * draw(SIZES), sign * draw(SIZES)
    if kind == "constant":
        return constant(right)
    if kind == "flat":
        return constant(np.inf)
    if kind == "linear":
        return {"law": "linear", "right_mm": right, "left_mm": left}
    if kind == "power":
        return {"law": "power", "right_mm": right, "left_mm": left, "exponent": draw(st.floats(1.0, 8.0) | st.integers(1, 6))}
    if kind == "zones":
        # At an edge or away from it: a blend that begins some 0.005 mm beside one leaves a sliver that no span resolves.
        start = draw(st.just(0.0) | st.floats(0.02, 0.9))
        end = draw(st.just(1.0) | st.floats(start + 0.05, 0.98))
        return {"law": "zones", "right_mm": right, "left_mm": left, "blend_from": start, "blend_to": end,
                "blend": draw(st.sampled_from(["linear", "smooth"]))}
    if kind == "table":
        rows = draw(TABLES)
        return {"law": "table", "x_mm": list(np.linspace(-115.0, 115.0, len(rows))), "curvature_per_mm": rows}
    if kind == "waves":
        size, length = draw(st.floats(-0.003, 0.003)), draw(st.floats(15.0, 200.0))
        return {"law": "expression", "curvature": f"{size:.6g}*sin(x/{length:.6g}) + {1.0 / right:.6g}"}
    at, steep = draw(st.floats(-100.0, 100.0)), draw(st.floats(-2e-5, 2e-5))
    return {"law": "expression", "curvature": f"{1.0 / right:.6g} + {steep:.6g}*max(0, x - {at:.6g})"}


def smooth_upright(law: dict[str, Any]) -> dict[str, Any]:
    """The law, unless the decoupled surface made of it is creased or infinitely curved: it holds Ry″.

    A kink of Ry is a crease; t to a broken power has no finite second or third derivative at the right edge.
    """
    broken = law["law"] == "power" and law["exponent"] != int(law["exponent"])
    creased = law.get("blend") == "linear" or "max" in str(law.get("curvature"))
    return constant(1000.0) if creased or broken else law


ANY = given(laws(), laws().map(smooth_upright))


def designed_or_none(horizontal: dict[str, Any], vertical: dict[str, Any], **sections: Any) -> Mirror | None:
    """The mirror, or None where the laws turn vertical or their circles end: then the error names the place."""
    try:
        return mirror_cad.design(spec_of(horizontal, vertical, **sections))
    except ProfileError as error:
        assert "mm" in str(error)
        return None


def law_is_realised(horizontal: dict[str, Any], vertical: dict[str, Any]) -> None:
    """Tolerances met, by the fit's own word and at places it has not seen."""
    mirror = designed_or_none(horizontal, vertical)
    if mirror is None:
        return
    rng = np.random.default_rng(5)
    x, y = rng.uniform(-115.0, 115.0, 600), rng.uniform(-165.0, 165.0, 600)
    inside = mirror.outline.contains(x, y)
    x, y = x[inside], y[inside]
    want, got = mirror.exact.derivatives(x, y), mirror.surface.derivatives(x, y)
    rms = mirror.curvature.rms(mirror.outline)
    ours, exact = (np.stack(principal_curvatures_of(w), axis=-1) for w in (shape_operator(got), shape_operator_of_sag(want)))
    # A vertical law that swings puts curvature into the decoupled surface that no law asked for, y²·κ_y″/2, many times the
    # design's own: percent of the design are then below what float64 holds, and the fit says so.
    swinging = np.abs(exact).max() > 5.0 * rms
    # Nor can it where the circles all but end at the mirror's upper edge: slopes of 75° and more, whose curvature grows with
    # the third power of 1/cos.
    x_min, x_max, y_min, y_max = mirror.box
    sine = np.abs(mirror.curvature.vertical(np.linspace(x_min, x_max, 201))).max() * max(-y_min, y_max)
    steep = sine > np.sin(np.radians(75.0))
    if (swinging or steep) and not mirror.fit.met:
        assert np.isfinite(ours).all()
        return
    assert mirror.fit.met, mirror.fit
    assert np.abs(got["s"][:, 2] - want.z).max() <= 1e-5
    scale = mirror.curvature.reference_curvature(x, rms)
    if swinging:
        scale = np.maximum(scale, np.abs(exact).max(axis=1, keepdims=True))
    if scale.max() > 0.0:
        # The fit looks at five places a span or more, aims at 70 % of 0.01 % there, and says what it saw; between them the
        # error is at most about twice that (0.0131 % was seen).
        assert (np.abs(ours - exact) / scale).max() <= 2e-4


@settings(max_examples=25, derandomize=True, suppress_health_check=[HealthCheck.too_slow], phases=UNSHRUNK)
@ANY
def test_any_law_is_realised(horizontal: dict[str, Any], vertical: dict[str, Any]) -> None:
    law_is_realised(horizontal, vertical)


@pytest.mark.long
@settings(max_examples=1000, suppress_health_check=[HealthCheck.too_slow], phases=UNSHRUNK)
@ANY
def test_a_thousand_laws_are_realised(horizontal: dict[str, Any], vertical: dict[str, Any]) -> None:
    law_is_realised(horizontal, vertical)


def moved(surface: BSplineSurface, angles: tuple[float, float, float], shift: tuple[float, float, float]) -> BSplineSurface:
    """The surface turned about x, y, z and shifted."""
    from scipy.spatial.transform import Rotation

    return BSplineSurface(surface.degree_u, surface.degree_v, surface.knots_u, surface.knots_v,
                          surface.poles @ Rotation.from_euler("xyz", angles).as_matrix().T + np.array(shift))


@settings(max_examples=20)
@given(st.tuples(*[st.floats(-3.0, 3.0)] * 3), st.tuples(*[st.floats(-2e4, 2e4)] * 3))
def test_principal_curvatures_do_not_change_with_place(angles: tuple[float, float, float],
                                                       shift: tuple[float, float, float]) -> None:
    surface = designed("progressive-c").surface
    u, v = np.meshgrid(np.linspace(-110.0, 110.0, 9), np.linspace(-150.0, 150.0, 9))
    before, after = (principal_curvatures(each, u, v) for each in (surface, moved(surface, angles, shift)))
    # Rounding of poles 20 m away, 4e-12 mm, in second differences over spans of 5 mm and more: 2e-12 of 1e-3 per mm.
    assert np.abs(after - before).max() < 1e-9 * np.abs(before).max()


@settings(max_examples=10)
@given(st.floats(0.05, 20.0), st.floats(350.0, 1500.0), st.floats(600.0, 1500.0))
def test_percent_do_not_change_with_scale(scale: float, left: float, top: float) -> None:
    deviations = []
    for s in (1.0, scale):
        spec = spec_of({"law": "linear", "right_mm": 1250.0 * s, "left_mm": left * s},
                       {"law": "linear", "right_mm": top * s, "left_mm": 1100.0 * s},
                       blank={"width_mm": 250.0 * s, "height_mm": 380.0 * s},
                       outline={"width_mm": 230.0 * s, "left_height_mm": 270.0 * s, "right_height_mm": 340.0 * s,
                                "corner_radius_mm": 40.0 * s},
                       surface={"curvature_tolerance_percent": 0.001, "position_tolerance_mm": 1e-4},
                       export={"surface_margin_mm": 15.0 * s})
        mirror = mirror_cad.design(spec)
        deviations.append(against_design(mirror.curvature, mirror.outline, mirror.exact, mirror.surface))
    one, other = ((each.k1.max_percent, each.k2.rms_percent, each.shape.rms_percent, each.twist.rms_percent)
                  for each in deviations)
    # Twice the fit's own 0.001 %: on another scale it may choose other spans.
    assert one == pytest.approx(other, abs=2e-3)


def survives_step(horizontal: dict[str, Any], vertical: dict[str, Any]) -> None:
    """Poles, knots and curvature after writing and reading."""
    mirror = designed_or_none(horizontal, vertical)
    if mirror is None:
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "any.step"
        mirror.export_step(path)
        read = read_step(path).optical_surface()
    x, y = np.meshgrid(np.linspace(-114.0, 114.0, 21), np.linspace(-130.0, 130.0, 21))
    assert np.abs(read.evaluate(x, y) - mirror.surface.evaluate(x, y)).max() < 1e-9
    scale = mirror.curvature.reference_curvature(x.ravel(), mirror.curvature.rms(mirror.outline)).reshape(*x.shape, 2)
    if scale.max() > 0.0:
        difference = np.abs(principal_curvatures(read, x, y) - principal_curvatures(mirror.surface, x, y))
        assert (100.0 * difference / scale).max() <= 1e-6  # percent: what the STEP stage may add


@settings(max_examples=6, suppress_health_check=[HealthCheck.too_slow], phases=UNSHRUNK)
@given(st.floats(300.0, 3000.0), st.floats(300.0, 3000.0), SIGNS)
def test_step_keeps_the_curvature(right: float, left: float, sign: float) -> None:
    survives_step({"law": "linear", "right_mm": sign * right, "left_mm": sign * left}, constant(1200.0))


@pytest.mark.long
@settings(max_examples=60, suppress_health_check=[HealthCheck.too_slow], phases=UNSHRUNK)
@given(st.floats(300.0, 3000.0), st.floats(300.0, 3000.0), SIGNS, laws().map(smooth_upright))
def test_step_keeps_the_curvature_of_many(right: float, left: float, sign: float, vertical: dict[str, Any]) -> None:
    survives_step({"law": "linear", "right_mm": sign * right, "left_mm": sign * left}, vertical)


@settings(max_examples=15)
@given(st.floats(250.0, 1e5), SIGNS, st.booleans())
def test_cylinders_are_exact(radius: float, sign: float, across: bool) -> None:
    """Curved in one direction only, the decoupled surface is the cylinder: 1/R and 0, no twist."""
    laws_of = constant(sign * radius), constant(np.inf)
    mirror = mirror_cad.design(spec_of(*(laws_of if across else laws_of[::-1])))
    x, y = np.meshgrid(np.linspace(-114.0, 114.0, 15), np.linspace(-160.0, 160.0, 15))
    w = shape_operator(mirror.surface.derivatives(x, y))
    curved, straight = (w.w11, w.w22) if across else (w.w22, w.w11)
    # 0.01 % asked of the fit; the straight direction and the twist are zero to rounding.
    assert np.abs(curved * sign * radius - 1.0).max() <= 1e-4
    assert max(np.abs(straight).max(), np.abs(w.w12).max()) < 1e-9


def test_stages_add_up_at_every_place() -> None:
    """Design, model, integration, fit and file: their differences in kx, ky, twist and height sum to the total's."""
    laws_of = ({"law": "linear", "right_mm": 1250.0, "left_mm": left} for left in (800.0, 900.0))
    spec = spec_of(*laws_of, surface={"integration": "euler", "step_mm": 1.0})
    deviation = mirror_cad.design(spec).deviation()
    states = list(deviation.states)
    parts = [[b - a for a, b in zip(before.shape, after.shape, strict=True)] + [after.height - before.height]
             for before, after in itertools.pairwise(states)]
    percent = deviation.percent
    assert percent is not None
    for k, (key, designed_value) in enumerate((("kx", deviation.designed.w11), ("ky", deviation.designed.w22))):
        assert np.abs(sum(part[k] for part in parts) / designed_value - getattr(percent, key) / 100.0).max() < 1e-12
    worst = float(np.abs(sum(part[3] for part in parts)).max())
    assert worst == pytest.approx(abs(deviation.total.sag_max_mm), rel=1e-6)  # ties of the two symmetric halves
    # Principal curvatures are not linear: their parts bound the total, and each part here matters.
    for key in ("k1", "k2"):
        assert abs(deviation.total.of(key).max_percent) <= sum(
            abs(stage.of(key).max_percent) for stage in (deviation.stages.model, *deviation.stages.numerical()))
    assert deviation.explained.unexplained_max_per_m < 1e-12
    assert deviation.stages.integration.shape.rms_percent > 0.01
