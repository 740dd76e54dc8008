"""The driver's picture by another renderer: Mitsuba, on a mesh of a million triangles with smooth normals."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from mirror_studio.bench.tracers import pictures
from mirror_studio.bench.tracers.case import Case
from mirror_studio.bench.tracers.mitsuba_mesh import SCALAR, use
from raytrace.image import photograph
from raytrace.viewing.camera import Frame
from tests.conftest import designed

TRIANGLES = 1_000_000
SAMPLES = 64  # a pixel; Mitsuba's are random within the cells of a grid, ours in their middles


@pytest.fixture(scope="module")
def both() -> tuple[np.ndarray, np.ndarray]:
    """The reference plane in progressive-c, ours and Mitsuba's, (240, 320, 3)."""
    case = Case(designed("progressive-c"))
    frame, scene = pictures.frame_of(320, 240), pictures.reference_plane(case)
    return by_us(case, scene, frame), by_mitsuba(case, scene, frame)


def by_us(case: Case, scene: Any, frame: Frame) -> np.ndarray:
    """The mean of a picture eight times finer: as many rays for every pixel, not only where it shows an edge."""
    fine = Frame(frame.left, frame.top, frame.pixel / 8.0, 8 * frame.columns, 8 * frame.rows)
    view = photograph(case.reflector, fine.camera(case.eye), scene, samples=1)[0]
    return view.reshape(frame.rows, 8, frame.columns, 8, 3).mean(axis=(1, 3))


def by_mitsuba(case: Case, scene: Any, frame: Frame) -> np.ndarray:
    mi = use(SCALAR)
    mirror = pictures.mesh_of(mi, case.mesh(TRIANGLES), props=pictures._mirror_properties(mi))
    sensor = pictures._sensor(mi, case, frame)
    sensor["sampler"] = {"type": "stratified", "sample_count": SAMPLES}
    loaded = mi.load_dict({"type": "scene", "mirror": mirror, "sensor": sensor, **pictures._plane(mi, scene),
                           "integrator": {"type": "direct", "emitter_samples": 0, "bsdf_samples": 1}})
    return 255.0 * np.array(mi.render(loaded, spp=SAMPLES, seed=1), dtype=np.float64)


def kept(folder: Path, ours: np.ndarray, theirs: np.ndarray) -> Path:
    """Both pictures and ten times their difference beside each other, for whoever has to find out why a test failed."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "ours-theirs-difference.png"
    strip = np.concatenate([ours, theirs, 128.0 + 10.0 * (ours - theirs)], axis=1)
    Image.fromarray(np.clip(np.rint(strip), 0, 255).astype(np.uint8)).save(path)
    return path


def test_the_pictures_are_the_same_to_half_a_value(both: tuple[np.ndarray, np.ndarray], tmp_path: Path) -> None:
    ours, theirs = both
    apart = np.abs(ours - theirs).mean()
    assert apart <= 0.5, f"mean difference {apart:.3f} of 255: see {kept(tmp_path, ours, theirs)}"


def test_lane_edges_lie_at_the_same_place_to_a_twentieth_of_a_pixel(both: tuple[np.ndarray, np.ndarray],
                                                                    tmp_path: Path) -> None:
    """Where the yellow line's two edges cross each column, found between pixels by its yellowness.

    One column's edge is known to some 0.03 pixels, for both pictures sample it in 64 places of a pixel: the root of the
    mean square over all columns is judged, and the mean, which is a shift.
    """
    ours, theirs = both
    differences = []
    for column in range(ours.shape[1]):
        a, b = (crossings(picture[:, column]) for picture in (ours, theirs))
        if len(a) == len(b) == 2:
            differences.append(np.array(a) - np.array(b))
    apart = np.array(differences)
    assert len(apart) > 150, f"the line is found in {len(apart)} columns: see {kept(tmp_path, ours, theirs)}"
    where = f"see {kept(tmp_path, ours, theirs)}"
    assert np.sqrt(np.mean(apart**2)) <= 0.05, where
    assert np.abs(apart.mean(axis=0)).max() <= 0.01, where


def crossings(column: np.ndarray) -> list[float]:
    """Rows where yellowness, the mean of red and green less blue, crosses 50 up and down around its highest place."""
    yellowness = 0.5 * (column[:, 0] + column[:, 1]) - column[:, 2]
    peak = int(np.argmax(yellowness))
    if yellowness[peak] < 80.0:
        return []
    found = []
    for step in (-1, 1):
        i = peak
        while 0 <= i + step < len(yellowness) and yellowness[i + step] >= 50.0:
            i += step
        if not 0 <= i + step < len(yellowness):
            return []
        found.append(i + step * (yellowness[i] - 50.0) / (yellowness[i] - yellowness[i + step]))
    return found
