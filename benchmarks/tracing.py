"""A mirror in, error and rate of reflection side by side out: ours on the B-spline, Embree on facets of an STL.

    python benchmarks/tracing.py [RAYS]

The mirror is a cap of a true sphere, so the error has a closed form; every row is the median of five runs in this process.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import mirror_cad
import raytrace
from mirror_cad.occt.step import GLASS_COLOUR, Part, read_step, write_step
from mirror_cad.occt.tessellate import write_stl
from raytrace.eye import eye_position

RADIUS_MM = 950.0
ARCSEC = np.degrees(1.0) * 3600.0


def main(rays: int) -> None:
    """Print the table."""
    from build123d import Box, Pos, Sphere

    eye = eye_position(762.0, "right", (-115.0, 115.0, -170.0, 170.0))
    columns = int(np.sqrt(rays * 230 / 340))
    x, y = np.meshgrid(np.linspace(-115, 115, columns), np.linspace(-160, 160, rays // columns))
    directions = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) - eye
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    from_centre = eye + [0.0, 0.0, RADIUS_MM]
    b = directions @ from_centre
    normal = (from_centre + (-b - np.sqrt(b * b - from_centre @ from_centre + RADIUS_MM**2))[:, None] * directions) / RADIUS_MM
    exact = directions - 2.0 * np.einsum("ij,ij->i", directions, normal)[:, None] * normal
    print(f"{len(directions)} rays, pixel order, one eye; sphere of {RADIUS_MM:g} mm\n"
          f"{'method':<52}{'largest error':>15}{'RMS, arcsec':>13}{'Mrays/s':>9}")
    with tempfile.TemporaryDirectory() as folder:
        step = Path(folder) / "sphere.step"
        cap = Pos(0, 0, -RADIUS_MM) * Sphere(RADIUS_MM) & Box(260, 400, 80)
        write_step(step, [Part(cap.wrapped, "sphere", GLASS_COLOUR)], "sphere")
        rows: list[tuple[str, raytrace.Reflector]] = [("rational B-spline of the sphere, parametric kernel",
                                                       raytrace.load_reflector(step))]
        for deflection in (0.1, 0.01, 0.001):
            stl = Path(folder) / "sphere.stl"
            write_stl(stl, read_step(step).shape, deflection)
            mesh = raytrace.load_reflector(stl)
            count = len(mesh.mesh.faces) if mesh.mesh else 0
            rows.append((f"Embree, facets of an STL of {count} triangles", mesh))
        for name, reflector in rows:
            report(name, reflector, eye, directions, exact)
    # The height-field kernel, on a mirror of ours: the decoupled surface is no sphere, so its error is against the
    # parametric kernel on the same surface.
    ours = raytrace.Reflector.from_mirror(mirror_cad.design(mirror_cad.load_spec("sphere-950")))
    general = raytrace.Reflector.from_mirror(mirror_cad.design(mirror_cad.load_spec("sphere-950")))
    general.surfaces[0].__dict__["height_field"] = None
    report("our mirror, height-field kernel (against parametric)", ours, eye, directions,
           raytrace.reflect(general, eye, directions).directions)


def report(name: str, reflector: raytrace.Reflector, eye: np.ndarray, directions: np.ndarray, exact: np.ndarray) -> None:
    """Trace five times and print a row."""
    trace = raytrace.reflect(reflector, eye, directions)
    times = []
    for _ in range(5):
        start = time.perf_counter()
        raytrace.reflect(reflector, eye, directions, out=trace)
        times.append(time.perf_counter() - start)
    hit = trace.status == 0
    error = np.linalg.norm(trace.directions[hit] - exact[hit], axis=1) * ARCSEC
    print(f"{name:<52}{error.max():>15.2g}{np.sqrt(np.mean(error**2)):>13.2g}"
          f"{len(directions) / statistics.median(times) / 1e6:>9.2f}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 500_000)
