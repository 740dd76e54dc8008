"""Distances of a million measured points from the exact surface, beside those from a mesh of it by Open3D.

    python -m venv /somewhere/o3d && /somewhere/o3d/bin/pip install open3d-cpu==0.19.0
    python scripts/mesh_distance.py /somewhere/o3d/bin/python

Points of progressive-c are put off its surface along the normal by 5 µm of noise, which is what a distance has to give back.
The mesh is the STL that `export_stl` writes, at the deflection that stands in the table. Prints processor time, error and wrong
signs of each; then processor time and memory of a whole inspection of these points in a pose of their own.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from mirror_cad import design, load_spec
from mirror_cad.made.inspection import inspect
from mirror_cad.made.nominal import Nominal

COUNT, NOISE_MM = 1_000_000, 0.005
DEFLECTIONS_MM = (0.01, 0.001)
BY_OPEN3D = """
import sys, time
import numpy as np, open3d
points, mesh, out = sys.argv[1:]
mesh = open3d.io.read_triangle_mesh(mesh)
at = np.load(points).astype(np.float32)
begun = time.process_time()
scene = open3d.t.geometry.RaycastingScene()
scene.add_triangles(open3d.t.geometry.TriangleMesh.from_legacy(mesh))
found = scene.compute_signed_distance(open3d.core.Tensor(at)).numpy()
np.save(out, found)
print(time.process_time() - begun, len(mesh.triangles))
"""


def main(python: str) -> None:
    """Print the table.

    Parameters
    ----------
    python : str
        An interpreter that has open3d.
    """
    mirror, rng = design(load_spec("progressive-c")), np.random.default_rng(1)
    nominal = Nominal(mirror.surface, mirror.outline)
    x_min, x_max, y_min, y_max = (0.95 * end for end in mirror.box)  # off the rim, where a mesh of a plate has its sides
    xy = rng.uniform((x_min, y_min), (x_max, y_max), (2 * COUNT, 2))
    xy = xy[mirror.outline.contains(xy[:, 0] / 0.95, xy[:, 1] / 0.95)][:COUNT]
    z, z_x, z_y = nominal.heights(xy[:, 0], xy[:, 1])
    off = rng.normal(0.0, NOISE_MM, len(xy))
    along = off / np.sqrt(1.0 + z_x**2 + z_y**2)
    points = np.column_stack([xy[:, 0] - along * z_x, xy[:, 1] - along * z_y, z + along])
    del xy, z, z_x, z_y, along
    nominal.feet(points[:100])
    begun = time.process_time()
    found = nominal.feet(points).distance
    _print("exact surface", time.process_time() - begun, found, off)
    with tempfile.TemporaryDirectory() as folder:
        here = Path(folder)
        np.save(here / "points.npy", points)
        for deflection in DEFLECTIONS_MM:
            mirror.export_stl(here / "mirror.stl", deflection)
            done = subprocess.run([python, "-c", BY_OPEN3D, str(here / "points.npy"), str(here / "mirror.stl"),
                                   str(here / "found.npy")], capture_output=True, text=True, check=True)
            seconds, triangles = done.stdout.split()
            _print(f"Open3D, {deflection:g} mm, {int(triangles):,} triangles", float(seconds),
                   np.load(here / "found.npy").astype(np.float64), off)
    turn = Rotation.from_rotvec([0.2, 0.1, -0.3]).as_matrix()
    inspect(nominal, points[:5000])  # kernels are loaded
    begun = time.process_time()
    inspect(nominal, points @ turn.T + [600.0, -700.0, 400.0])
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    print(f"inspection with alignment, fit and maps: {time.process_time() - begun:.1f} s, {memory:.0f} MB at most")


def _print(name: str, seconds: float, found: np.ndarray, off: np.ndarray) -> None:  # type: ignore[type-arg]
    error = found - off
    wrong = float((np.sign(found) != np.sign(off)).mean())
    rms, largest = 1e3 * np.sqrt(np.mean(error**2)), 1e3 * np.abs(error).max()
    print(f"{name:44} {seconds:6.1f} s  RMS {rms:8.2g} µm  largest {largest:8.2g} µm  wrong sign {100.0 * wrong:.2f} %")


if __name__ == "__main__":
    main(sys.argv[1])
