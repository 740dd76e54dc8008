"""Mirrors as they may come out: their measures against closed forms, the indices against known ones, and what is refused."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from mirror_cad import design, load_spec
from mirror_cad.errors import SpecError
from mirror_cad.made.form_error import Waves, random_map, shortest_wavelength, wave, with_form_error
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.collocation import collocate_height, knot_vector
from mirror_studio.cli import run
from mirror_studio.explore.evaluate import Row
from mirror_studio.progress import Progress
from mirror_studio.tolerances.file import Tolerances, load_tolerances
from mirror_studio.tolerances.made import Departures, FormOfRow, evaluate_made, reflector_made
from mirror_studio.tolerances.statistics import outcomes, sobol_indices

Array = NDArray[np.float64]

STUDY = """
spec = "sphere-950"
measures = ["h_fov_traced_deg"]
samples = 16
[keys]
"horizontal.radius_mm" = { sigma = 4.0, also = ["vertical.radius_mm"] }
[eye]
right_mm = { within = 20.0 }
rearward_mm = { within = 15.0 }
"""


def study(tmp_path: Path, text: str) -> Tolerances:
    path = tmp_path / "study.toml"
    path.write_text(text, encoding="utf-8")
    return load_tolerances(path)


def rows_of(loaded: Tolerances) -> list[Row]:
    return [evaluate_made(k, values, loaded.with_values(values), ".", loaded.scene, loaded.measures)
            for k, values in enumerate(loaded.mirrors())]


@pytest.fixture(autouse=True)
def no_cluster(monkeypatch: pytest.MonkeyPatch) -> None:
    """These few mirrors are made in this process: a cluster of others takes seconds to start."""
    monkeypatch.setattr("mirror_studio.explore.workers.FEW", 10_000)


def sphere_field_deg(radius: float, eye: Array) -> float:
    """Between the rays that a sphere through the origin reflects at (±115, 0), seen from an eye: by hand."""
    found = []
    for x in (-115.0, 115.0):
        # The ray is aimed at the point of the surface itself.
        normal = np.array([x, 0.0, np.sqrt(radius**2 - x * x)]) / radius
        to = np.array([x, 0.0, normal[2] * radius - radius]) - eye
        to = to / np.linalg.norm(to)
        found.append(to - 2.0 * (to @ normal) * normal)
    return float(np.degrees(np.arccos(found[0] @ found[1])))


def test_a_sphere_s_field_follows_its_radius_and_the_eye(tmp_path: Path) -> None:
    """Every mirror has the closed form's angle; its spread is what the derivatives say, and so are the shares."""
    loaded = study(tmp_path, STUDY)
    assert loaded.keys == ("horizontal.radius_mm", "eye.right_mm", "eye.rearward_mm")
    eye = np.array([115.0, 0.0, np.sqrt(762.0**2 - 115.0**2)])
    found = rows_of(loaded)

    def field(values: Array) -> float:
        return sphere_field_deg(950.0 + values[0], eye + [values[1], 0.0, values[2]])

    known = [field(np.array(row.values, dtype=float)) for row in found]
    assert [row.figures[0] for row in found] == pytest.approx(known, abs=1e-6)  # degrees: the sphere is fitted to 1e-9 mm
    slopes = [(field(step) - field(-step)) / 2.0 for step in np.eye(3)]
    sigmas = np.array([4.0, 20.0 / np.sqrt(3.0), 15.0 / np.sqrt(3.0)])
    parts = (np.array(slopes) * sigmas) ** 2
    summed = outcomes(loaded, found[0], found).by_measure["h_fov_traced_deg"]
    assert summed.sigma == pytest.approx(np.sqrt(parts.sum()), rel=0.15)  # 80 mirrors know a sigma to 8 %
    for index, part in zip(summed.indices.values(), parts / parts.sum(), strict=True):
        assert index.total_interval[0] - 0.02 < part < index.total_interval[1] + 0.02
    assert summed.interval == pytest.approx(np.quantile(known, [0.025, 0.975]), abs=1e-6)


def test_the_interval_of_one_radius_is_that_of_its_derivative(tmp_path: Path) -> None:
    """± 1.96 σ·|dF/dR|, as far as the middle 95 % of so few mirrors go."""
    loaded = study(tmp_path, STUDY[: STUDY.index("[eye]")].replace("samples = 16", "samples = 32"))
    found = rows_of(loaded)
    eye = np.array([115.0, 0.0, np.sqrt(762.0**2 - 115.0**2)])
    slope = (sphere_field_deg(951.0, eye) - sphere_field_deg(949.0, eye)) / 2.0
    summed = outcomes(loaded, found[0], found).by_measure["h_fov_traced_deg"]
    assert summed.interval is not None
    half = 1.96 * 4.0 * abs(slope)
    assert np.array(summed.interval) - sphere_field_deg(950.0, eye) == pytest.approx([-half, half], rel=0.12)
    assert summed.indices["horizontal.radius_mm"].first == 1.0  # there is no other


def test_indices_of_a_linear_function_and_of_ishigami_s_are_known() -> None:
    """Σ a·x has a²/Σa²; Ishigami's are in Saltelli's book: 0.3139, 0.4424, 0, with totals 0.5576, 0.4424, 0.2437."""
    from scipy.special import ndtri
    from scipy.stats import qmc

    def indices(function: object, width: int, count: int) -> list[tuple[float, float]]:
        shares = qmc.Sobol(2 * width, rng=3).random(count)
        a, b = shares[:, :width], shares[:, width:]
        blocks = [a, b, *(np.where(np.arange(width) == k, b, a) for k in range(width))]
        found, used = sobol_indices(np.array([function(block) for block in blocks]), [str(k) for k in range(width)])  # type: ignore[operator]
        assert used == count
        return [(each.first, each.total) for each in found.values()]

    weights = np.array([3.0, 2.0, 1.0, 0.0])
    linear = indices(lambda u: ndtri(u) @ weights, 4, 1024)
    for (first, total), wanted in zip(linear, weights**2 / 14.0, strict=True):
        assert (first, total) == pytest.approx((wanted, wanted), abs=0.02)
    assert linear[3] == (0.0, 0.0)

    def ishigami(u: Array) -> Array:
        x = np.pi * (2.0 * u - 1.0)
        return np.asarray(np.sin(x[:, 0]) + 7.0 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0]))

    known = [(0.3139, 0.5576), (0.4424, 0.4424), (0.0, 0.2437)]
    for one, wanted in zip(indices(ishigami, 3, 1024), known, strict=True):
        assert one == pytest.approx(wanted, abs=0.03)


def test_samples_without_a_figure_are_left_out_of_the_indices() -> None:
    values = np.random.default_rng(0).normal(size=(4, 16))
    values[2, 5] = np.nan
    found, used = sobol_indices(values, ["a", "b"])
    assert used == 8
    assert list(found) == ["a", "b"]
    assert sobol_indices(np.ones((4, 16)), ["a", "b"]) == ({}, 0)


@pytest.mark.parametrize("degree", [3, 4, 5, 7])
def test_a_wave_is_added_as_it_is(degree: int) -> None:
    """Height to 1e-4 of its amplitude, curvature to 0.2 %, at every degree; what it is added to is kept to rounding."""
    base = paraboloid(degree)
    rng = np.random.default_rng(degree)
    x, y = rng.uniform(-95.0, 95.0, (2, 2000))
    a, length, alpha, phase = 0.02, 45.0, 0.7, 0.3
    found = with_form_error(base, wave(a, length, alpha, phase))
    k = 2.0 * np.pi / length
    sine = np.sin(k * (x * np.cos(alpha) + y * np.sin(alpha)) + phase)
    assert np.abs(found.sag(x, y) - base.sag(x, y) - a * sine).max() < 1e-4 * a
    bend = found.derivatives(x, y)["uu"][:, 2] - base.derivatives(x, y)["uu"][:, 2]
    assert np.abs(bend + a * (k * np.cos(alpha)) ** 2 * sine).max() < 2e-3 * a * (k * np.cos(alpha)) ** 2
    kept = with_form_error(base, wave(0.0, length, alpha, phase))
    assert np.abs(kept.sag(x, y) - base.sag(x, y)).max() < 1e-12


def paraboloid(degree: int) -> BSplineSurface:
    knots = knot_vector(np.linspace(-100.0, 100.0, 7), (), degree)
    return collocate_height(lambda x, y: -(x * x + 0.7 * y * y) / 2400.0, knots, knots, degree)


def test_a_random_map_has_its_size_and_its_band() -> None:
    """Over many draws: RMS as stated, normal heights, and waves within a quarter of the one that is stated."""
    rng = np.random.default_rng(1)
    at = rng.uniform(-500.0, 500.0, (2, 400))
    heights = np.concatenate([random_map(0.01, 60.0, rng).height(*at) for _ in range(100)])
    assert np.sqrt(np.mean(heights**2)) == pytest.approx(0.01, rel=0.02)
    assert np.mean(heights**4) / np.mean(heights**2) ** 2 == pytest.approx(3.0, abs=0.15)
    lengths = random_map(0.01, 60.0, rng).wavelength
    assert (np.abs(lengths - 60.0) <= 15.0).all()
    assert isinstance(random_map(0.01, 60.0, rng), Waves)


def test_rays_turn_as_the_wave_s_slope_says() -> None:
    """Each ray is reflected about the normal of the exact sum, worked out by hand: to 1e-3 of what the wave turns it by."""
    mirror = design(load_spec("progressive-c"))
    eye = np.array([115.0, 0.0, 753.0])
    x, y = np.random.default_rng(2).uniform(-90.0, 90.0, (2, 300))
    a, length = 0.02, 60.0
    made = reflector_made(mirror, Departures((FormOfRow(a, length, 30.0, 70.0, None),)))
    k, alpha = 2.0 * np.pi / length, np.radians(30.0)
    cosine = a * k * np.cos(k * (x * np.cos(alpha) + y * np.sin(alpha)) + np.radians(70.0))
    sine = a * np.sin(k * (x * np.cos(alpha) + y * np.sin(alpha)) + np.radians(70.0))
    z, zx, zy = mirror.surface.heights(x, y)

    def reflected(height: Array, slope_x: Array, slope_y: Array) -> Array:
        normal = np.stack([-slope_x, -slope_y, np.ones_like(slope_x)], axis=1)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        to = np.stack([x, y, height], axis=1) - eye
        to /= np.linalg.norm(to, axis=1, keepdims=True)
        return np.asarray(to - 2.0 * np.einsum("ij,ij->i", to, normal)[:, None] * normal)

    wanted = reflected(z + sine, zx + cosine * np.cos(alpha), zy + cosine * np.sin(alpha))
    turned = np.linalg.norm(wanted - reflected(z, zx, zy), axis=1)
    assert 10800.0 / np.pi * turned.max() == pytest.approx(2.0 * a * k * 10800.0 / np.pi, rel=0.2)  # some 14′
    found = made.surface.reflected_at(eye, x, y)[1]
    assert np.linalg.norm(found - wanted, axis=1).max() < 1e-3 * turned.max()


def test_a_wedge_turns_a_ray_as_a_prism_does() -> None:
    """A plane mirror behind glass that becomes thicker to the right by 3′: Snell in the plane, by hand."""
    spec = load_spec("flat")
    spec = spec.model_copy(update={"glass": spec.glass.model_copy(update={"reflecting": "back"})})
    made = reflector_made(design(spec), Departures(wedge_arcmin=(3.0, 0.0)))
    eye, n, wedge = np.array([0.0, 0.0, 800.0]), 1.52, np.radians(3.0 / 60.0)
    from raytrace.trace import reflect

    for degrees in (-8.0, 0.0, 5.0):
        down = np.radians(degrees)  # of the ray to −z, towards +x
        trace = reflect(made, eye, np.array([[np.sin(down), 0.0, -np.cos(down)]]))
        # The front's normal leans to −x by the wedge: angles to it are those to z and the wedge.
        inside = np.arcsin(np.sin(down - wedge) / n) + wedge
        out = np.arcsin(n * np.sin(inside + wedge)) - wedge  # after the plane back, which keeps the sense of x
        assert float(np.arctan2(trace.directions[0, 0], trace.directions[0, 2])) == pytest.approx(out, abs=1e-9)
    level = reflector_made(design(spec), Departures())
    assert reflect(level, eye, np.array([[0.0, 0.0, -1.0]])).directions[0] == pytest.approx([0.0, 0.0, 1.0], abs=1e-12)


def test_a_mirror_is_turned_from_its_aim(tmp_path: Path) -> None:
    text = """
spec = "sphere-1250"
scene = "motorway"
measures = ["yaw_deg", "pitch_deg"]
[aim]
yaw_deg = { sigma = 0.5 }
pitch_deg = { within = 0.4 }
"""
    loaded = study(tmp_path, text)
    designed = evaluate_made(0, (), loaded.as_designed(), ".", loaded.scene, loaded.measures)
    turned = evaluate_made(0, (), loaded.with_values((0.3, -0.2)), ".", loaded.scene, loaded.measures)
    assert designed.status == turned.status == "ok"
    assert [b - a for a, b in zip(designed.figures, turned.figures, strict=True)] == pytest.approx([0.3, -0.2], abs=1e-9)  # type: ignore[operator]


def test_what_was_solved_for_stays_as_it_was_designed(tmp_path: Path) -> None:
    """A radius that comes out smaller is not made up for by another blend."""
    text = STUDY.replace("sphere-950", "progressive-c").replace(
        '"horizontal.radius_mm" = { sigma = 4.0, also = ["vertical.radius_mm"] }', '"horizontal.left_mm" = { sigma = 4.0 }')
    loaded = study(tmp_path, text)
    assert loaded.raw["horizontal"]["blend_from"] == pytest.approx(0.5865, abs=1e-3)
    assert loaded.with_values((3.0, 0.0, 0.0))["spec"]["horizontal"]["left_mm"] == 403.0


def test_the_command_writes_its_set_and_goes_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit 3 where the interval leaves a limit; the same command again makes no mirror and the same tables."""
    path, out = tmp_path / "study.toml", tmp_path / "out"
    text = STUDY[: STUDY.index("[eye]")].replace("samples = 16", "samples = 8")
    path.write_text(text + "[limits]\nh_fov_traced_deg = [44.7, inf]\n", encoding="utf-8")
    assert run(["tolerances", str(path), "--out", str(out)]) == 3
    assert "missed: h_fov_traced_deg: 95 % of the mirrors have" in capsys.readouterr().err
    content = json.loads((out / "tolerances.json").read_text("utf-8"))
    with (out / "rows.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert content["mirrors"] == len(rows) == 24
    values = np.array([float(row["h_fov_traced_deg"]) for row in rows])
    one = content["measures"]["h_fov_traced_deg"]
    assert one["share_inside"] == pytest.approx(float((values >= 44.7).mean()))
    assert one["share_inside_interval"][0] < one["share_inside"] < one["share_inside_interval"][1]
    assert one["mean"] == pytest.approx(values.mean())
    assert one["limit"] == [44.7, None]
    assert (out / "tolerances.html").read_text("utf-8").count("data:image/svg+xml") == 1
    before = {each.name: each.read_bytes() for each in out.iterdir() if each.suffix != ".parquet"}
    lines = (out / "study.jsonl").read_bytes().splitlines(keepends=True)
    (out / "study.jsonl").write_bytes(b"".join(lines[:10]) + lines[10][:7])  # as after a kill amid a line
    assert run(["tolerances", str(path), "--out", str(out)]) == 3
    assert {each.name: each.read_bytes() for each in out.iterdir() if each.suffix != ".parquet"} == before


@pytest.mark.parametrize(("change", "said"), [
    (("sigma = 4.0", "sigma = -4.0"), r"sigma = -4"),
    (("sigma = 4.0", "sigma = 0.0"), r"sigma = 0"),
    (("sigma = 4.0", "sigma = 4.0, within = 5.0"), r"give one of sigma .* and within"),
    (("horizontal.radius_mm", "horizontal.radus_mm"), r"no number of this name; did you mean 'horizontal\.radius_mm'"),
    (("vertical.radius_mm", "horizontal.radius_mm"), r"has a tolerance already"),
    (("h_fov_traced_deg", "h_fov_trced_deg"), r"unknown measure.*did you mean 'h_fov_traced_deg'"),
    (('"h_fov_traced_deg"', '"horizon_either_deg"'), r"measure of a mirror on its vehicle: give scene"),
    (("samples = 16", "samples = 100"), r"must be a power of two: 64 or 128"),
    (("right_mm =", "rigt_mm ="), r"eye\.rigt_mm.*did you mean 'right_mm'"),
    (("[eye]", "[eyes]"), r"eyes: unknown.*did you mean '?\[?eye"),
    (("sphere-950", "sphere-940"), r"did you mean the preset 'sphere-950'"),
    (("[eye]", "[form.a]\namplitude_mm = 0.02\nwavelength_mm = 2.0\n[eye]"),
     r"form\.a\.wavelength_mm = 2: is shorter than what the spans of a surface of this size hold, [\d.]+ mm"),
    (("[eye]", "[form.a]\nrms_mm = 0.02\nwavelength_mm = 50.0\n[eye]"), r"map = \"wave\" has amplitude_mm"),
    (("[eye]", "[wedge]\nacross_arcmin = { sigma = 1.0 }\n[eye]"), r"needs glass\.reflecting = \"back\""),
    (("[eye]", "[aim]\nyaw_deg = { sigma = 1.0 }\n[eye]"), r"aim: a mirror is aimed on its vehicle: give scene"),
])
def test_what_no_tolerance_can_be_is_refused(tmp_path: Path, change: tuple[str, str], said: str) -> None:
    assert change[0] in STUDY
    with pytest.raises(SpecError, match=said):
        study(tmp_path, STUDY.replace(*change))


def test_a_study_without_tolerances_and_a_design_that_cannot_be(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SpecError, match=r"no tolerance is given"):
        study(tmp_path, STUDY[: STUDY.index("[keys]")])
    path = tmp_path / "far.toml"
    path.write_text(STUDY.replace("rearward_mm = { within = 15.0 }", "up_mm = { within = 15.0 }"), encoding="utf-8")
    loaded = load_tolerances(path)
    broken = replace(loaded, raw=loaded.raw | {"eye": loaded.raw["eye"] | {"distance_mm": 10.0}})
    from mirror_cad.errors import MirrorError
    from mirror_studio.tolerances.run import tolerances

    with pytest.raises(MirrorError, match=r"the design without departures: .*eye"):
        tolerances(broken, tmp_path / "out", Progress(quiet=True))
    assert not (tmp_path / "out").exists()


def test_the_shortest_wave_is_what_a_surface_can_hold() -> None:
    base = design(load_spec("progressive-c")).surface
    least = shortest_wavelength(base)
    found = with_form_error(base, wave(0.001, 1.01 * least, 0.4, 0.0))
    patches = (len(np.unique(found.knots_u)) - 1) * (len(np.unique(found.knots_v)) - 1)
    assert 30_000 < patches < 45_000


def test_the_study_that_comes_along_can_be_read() -> None:
    loaded = load_tolerances(Path("progressive-c-glass"))
    assert loaded.scene == "motorway"
    assert len(loaded.factors) == 6
