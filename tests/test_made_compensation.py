"""The mould loop: it converges on a simulated bending whose laws it does not know."""

from __future__ import annotations

import json
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
import pytest

from mirror_cad import design, load_spec
from mirror_cad.cad_file import read_cad
from mirror_cad.made.compensation import Deviations, Forming, first_mould, next_mould
from mirror_cad.made.forming import SimulatedBending
from mirror_cad.made.inspection import inspect as inspect_over
from mirror_cad.made.nominal import Nominal
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.differential import principal_curvatures
from mirror_studio.cli import run

inspect = partial(inspect_over, gauge_mm=60.0)  # fewer spans than for 38 mm: tests of what holds for any gauge


@lru_cache
def nominal(name: str) -> Nominal:
    mirror = design(load_spec(name))
    return Nominal(mirror.surface, mirror.outline)


def test_the_loop_is_below_the_noise_in_three_rounds() -> None:
    """Bend and springback unknown to it, 5 µm noise: what is left of the true form is less than the noise of a point.

    The mirrors are measured on their datums: a best fit of a free surface would hide form behind a shift along the glass.
    """
    bending, rng = SimulatedBending(nominal("progressive-c")), np.random.default_rng(23)
    mould, left = None, []
    for _ in range(4):
        of = nominal("progressive-c").surface if mould is None else mould
        exact = SimulatedBending(bending.nominal, noise_mm=0.0).measured(of, 10.0, rng)
        d = exact[:, 2] - bending.nominal.heights(exact[:, 0], exact[:, 1])[0]
        left.append(float(np.sqrt(np.mean(d * d))))
        found = inspect(bending.nominal, bending.measured(of, 6.0, rng), align="none")
        mould = next_mould(bending.nominal, mould, Deviations((found.reconstruction.smooth,)), Forming())
    assert left[0] > 0.02
    assert left[3] < bending.noise_mm
    assert left[1] < 0.3 * left[0]


def test_a_known_springback_is_made_up_for_at_once() -> None:
    """Without noise and curl, one round leaves nothing."""
    bending = SimulatedBending(nominal("sphere-950"), springback=0.8, noise_mm=0.0)
    rng = np.random.default_rng(1)
    points = bending.measured(nominal("sphere-950").surface, 8.0, rng)
    found = inspect(bending.nominal, points, align="none")
    mould = next_mould(bending.nominal, None, Deviations((found.reconstruction.smooth,)), Forming(springback=0.8))
    again = bending.measured(mould, 8.0, rng)
    off = again[:, 2] - bending.nominal.heights(again[:, 0], again[:, 1])[0]
    assert np.abs(off).max() < 1e-5  # mm, a fit's position tolerance


def test_a_mould_behind_the_glass_is_its_offset_and_larger_by_the_shrink() -> None:
    """Of a sphere of 950 mm behind 3 mm of glass: 947 mm, and 1.002 times that."""
    mould = first_mould(nominal("sphere-950"), Forming(shrink=0.002, offset_mm=3.0))
    x, y = np.array([0.0, 60.0, -90.0]), np.array([0.0, 100.0, -40.0])
    assert 1.0 / principal_curvatures(mould, x, y) == pytest.approx(np.full((3, 2), 1.002 * 947.0), rel=1e-6)
    assert mould.sag(0.0, 0.0) == pytest.approx(-3.0 * 1.002, abs=1e-7)


def test_several_mirrors_are_averaged_and_their_scatter_is_told() -> None:
    """Three mirrors 10, 20 and 30 µm too high: the mean is 20 µm, its sigma 10/√3."""
    fits = []
    for height in (0.01, 0.02, 0.03):
        points = SimulatedBending(nominal("sphere-950"), 1.0, 0.0, 0.0, 0.0).measured(nominal("sphere-950").surface, 12.0,
                                                                                     np.random.default_rng(0))
        fits.append(inspect(nominal("sphere-950"), points + [0.0, 0.0, height], align="none").reconstruction.smooth)
    deviations = Deviations(tuple(fits))
    at = np.array([0.0, 30.0]), np.array([0.0, -50.0])
    assert deviations.mean(*at) == pytest.approx([0.02, 0.02], abs=1e-9)
    sigma = deviations.sigma(*at)
    assert sigma is not None
    assert sigma == pytest.approx(np.full(2, 0.01 / np.sqrt(3.0)), rel=1e-6)


@pytest.mark.long
def test_the_command_writes_a_mould_that_the_next_round_takes(tmp_path: Path) -> None:
    """Two rounds on files: the second correction is the small rest of the first."""
    bending, rng = SimulatedBending(nominal("progressive-c"), noise_mm=0.002), np.random.default_rng(5)
    mould, largest = None, []
    for round_ in range(2):
        surface = bending.nominal.surface if mould is None else read_mould(mould)
        data = tmp_path / f"mirror-{round_}.csv"
        np.savetxt(data, bending.measured(surface, 8.0, rng), fmt="%.9f", delimiter=",", header="x_mm,y_mm,z_mm", comments="")
        out = tmp_path / f"round-{round_}"
        more = [] if mould is None else ["--mould", str(mould)]
        assert run(["compensate", str(data), "--against", "progressive-c", "--align", "none", "--out", str(out), *more]) == 0
        largest.append(abs(json.loads((out / "compensation.json").read_text("utf-8"))["correction"]["max_mm"]))
        mould = out / "progressive-c-mould.step"
        assert (out / "report.html").is_file()
    assert largest[1] < 0.2 * largest[0]


@pytest.mark.parametrize(("arguments", "said"), [(["--gain", "0"], "--gain 0"), (["--springback", "-1"], "--springback -1"),
                                                 (["--mould", "nowhere.step"], "nowhere.step: no such file")])
def test_bad_options_of_a_mould_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str],
                                         said: str) -> None:
    data = tmp_path / "points.csv"
    data.write_text("x,y,z\n1,2,3\n", encoding="utf-8")
    assert run(["compensate", str(data), "--against", "progressive-c", "--out", str(tmp_path / "no"), *arguments]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "no").exists()


def read_mould(path: Path) -> BSplineSurface:
    surface = read_cad(path).shapes(list(read_cad(path).faces))[0].surface
    assert isinstance(surface, BSplineSurface)
    return surface
