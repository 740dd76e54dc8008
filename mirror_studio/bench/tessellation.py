"""Triangles, time and errors of a plate's STL at each deflection, beside the CAD libraries' defaults."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

from mirror_cad.design_stages import design
from mirror_cad.mesh_deviation import stl_deviation
from mirror_cad.mirror import Mirror
from mirror_cad.occt import peers
from mirror_cad.spec.file import load_spec
from mirror_cad.stl_file import read_stl
from mirror_studio.bench.measuring import convergence, median_seconds
from mirror_studio.bench.table import Column, Plot, Row, Table
from mirror_studio.report.text import fixed

DEFLECTIONS_MM = (0.1, 0.03, 0.01, 0.003, 0.001)
OURS = "ours, absolute"
ERRORS = ("height_mm", "normal_deg")


def tables(deflections_mm: tuple[float, ...] = DEFLECTIONS_MM) -> tuple[Table, ...]:
    """Errors over the number of facets, and how fast they fall."""
    mirror = design(load_spec("progressive-c"))
    solid = mirror.plate.solid  # made here, so that it is in no row's time
    with tempfile.TemporaryDirectory(prefix="mirror-cad-") as folder:
        path = Path(folder) / "mirror.stl"
        rows = [_row(mirror, path, OURS, wanted, partial(mirror.export_stl, path, wanted)) for wanted in deflections_mm]
        for library, export in (("build123d, default", peers.build123d_stl), ("cadquery, default", peers.cadquery_stl)):
            rows.append(_row(mirror, path, library, None, partial(export, solid, path)))
    orders = {key: convergence([1.0 / row["facets"] for row in rows if row["mesh"] == OURS],
                               [row[key] for row in rows if row["mesh"] == OURS]) for key in ERRORS}
    text = ("The plate of progressive-c written as STL, from the solid to the file: facets of the optical face, and their "
            "largest distance and angle from it. Ours takes the deflection as a length, measures what came and makes it finer "
            "where it does not hold, which is in the time; the libraries' defaults are relative to the size of the edges. "
            f"Observed: the height error falls with the number of facets to the power {fixed(orders['height_mm'].order, 2)} "
            f"(in theory 1), the normal error to the power {fixed(orders['normal_deg'].order, 2)} (0.5 for triangles of one "
            "shape). The floor is STL's float32: 8·10⁻⁶ mm.")
    columns = (Column("mesh", "mesh"), Column("wanted_mm", "deflection asked for, mm"), Column("facets", "optical facets"),
               Column("time_s", "time, s"), Column("height_mm", "height error, mm"),
               Column("normal_deg", "normal error, °"))
    plots = (Plot("facets", "height_mm", "mesh", "Height error over facets"),
             Plot("facets", "normal_deg", "mesh", "Normal error over facets"),
             Plot("time_s", "height_mm", "mesh", "Height error over time"))
    return (Table("tessellation", "Triangles for progressive-c", text, columns, tuple(rows), plots),)


def _row(mirror: Mirror, path: Path, mesh: str, wanted_mm: float | None, write: Callable[[], None]) -> Row:
    seconds = median_seconds(write)
    found = stl_deviation(read_stl(path), mirror.surface, mirror.outline)
    return {"mesh": mesh, "wanted_mm": wanted_mm, "facets": found.facets, "time_s": seconds,
            "height_mm": found.height_max_mm, "normal_deg": found.normal_max_deg}
