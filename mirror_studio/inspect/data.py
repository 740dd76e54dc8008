"""Measured data from a file of any kind, as points with what is known of their sigma."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import FileError
from mirror_cad.made.measured_table import LENGTHS, MeasuredTable, read_measured
from mirror_cad.made.nominal import Nominal
from mirror_cad.made.units import UNITS, likely_unit
from raytrace.file_kinds import CAD_KINDS, conversion
from raytrace.load import load_reflector
from raytrace.mesh_files import MESH_KINDS, read_mesh

Array = NDArray[np.float64]

TEXTS = (".csv", ".tsv", ".txt", ".xyz", ".asc", ".pts", ".dat")
FACE_SAMPLES = 90  # along the longer side of a face of a CAD file


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredPoints:
    """Points of a made mirror.

    Attributes
    ----------
    points : ndarray
        (n, 3), mm.
    sigmas : ndarray or None
        (n,), mm, where the file has them.
    not_numbers : int
        Rows that were left out for a cell that is empty or not finite.
    notes : tuple of str
        What was understood of the file that a user should know.
    """

    points: Array
    sigmas: Array | None
    not_numbers: int
    notes: tuple[str, ...]


def read_table(path: Path) -> MeasuredTable | None:
    """Read a table of measured values; None for meshes and CAD files, which hold points alone.

    Parameters
    ----------
    path : Path
        Of the file.

    Raises
    ------
    FileError
        For a file that holds no table, or is of a kind that is not read.
    """
    kind = path.suffix.lower()
    if kind in CAD_KINDS or kind == ".stl" or kind in MESH_KINDS:
        return None
    if kind not in TEXTS and conversion(kind):
        raise FileError(f"{path}: measured points are read from {', '.join((*TEXTS, '.stl', *MESH_KINDS, *CAD_KINDS))}"
                        f"{conversion(kind)}")
    return read_measured(path)


def read_points(path: Path, table: MeasuredTable | None, nominal: Nominal | None) -> MeasuredPoints:
    """Read points from a table, from the vertices of a mesh, or from a CAD file's face.

    Parameters
    ----------
    path : Path
        Of the file.
    table : MeasuredTable or None
        What `read_table` gave for it.
    nominal : Nominal or None
        The design, whose size and curvature tell a unit that the file does not state.

    Raises
    ------
    MirrorError
        For a file that holds no points of a mirror, with what is wrong with it.
    """
    kind = path.suffix.lower()
    if kind in CAD_KINDS:
        return MeasuredPoints(_of_face(path), None, 0, ("points of the file's face on a grid, without a sigma of their own",))
    if table is None:
        points, unit, sigmas, missing, notes = _of_mesh(path), None, None, 0, ["the vertices of the mesh"]
    else:
        points = np.stack([table.columns[key] for key in ("x", "y", "z")], axis=1)
        unit, sigmas, missing = table.length_unit, table.columns.get("sigma"), table.not_numbers
        notes = [f"columns that are not understood: {', '.join(table.ignored)}"] if table.ignored else []
        if sigmas is not None and not (sigmas > 0.0).all():
            row = int(np.argmin(sigmas > 0.0))
            raise FileError(f"{path}: the sigma of point {row + 1} is {sigmas[row]:g}: it must be above 0")
    if len(points) < 6:
        raise FileError(f"{path}: {len(points)} points tell no mirror: at least 6 are needed")
    if nominal is None:
        if unit is None:
            notes.append("no unit is stated; the coordinates are taken to be in mm")
        return MeasuredPoints(points, sigmas, missing, tuple(notes))
    likely = likely_unit(nominal, points)
    if unit is None:
        if likely is None:
            raise FileError(f"{path}: {_extent(points)}, and the mirror {nominal.size_mm:.4g} mm: in no unit do the points "
                            "have the size and curvature of this design; state the unit in the first line (x_mm), or look "
                            "whether it is another mirror")
        if likely != "mm":
            points = points * UNITS[likely]
            sigmas = None if sigmas is None else sigmas * UNITS[likely]
            notes.append(f"no unit is stated; by size and curvature the coordinates are in {likely}")
        else:
            notes.append("no unit is stated; the coordinates are taken to be in mm")
    elif likely is not None and UNITS[likely] != 1.0:
        raise FileError(f"{path}: its coordinates are stated in {unit}, and then they are no mirror of this design: "
                        f"{_extent(points)}, the mirror {nominal.size_mm:.4g} mm. They would fit "
                        f"{LENGTHS[unit] * UNITS[likely]:g} mm to the unit: state the right one")
    return MeasuredPoints(points, sigmas, missing, tuple(notes))


def _extent(points: Array) -> str:
    return f"the points reach over {float(np.linalg.norm(np.ptp(points, axis=0))):.4g} mm"


def _of_mesh(path: Path) -> Array:
    if path.suffix.lower() == ".stl":
        from mirror_cad.stl_file import read_stl

        return read_stl(path).vertices
    return read_mesh(path).vertices


def _of_face(path: Path) -> Array:
    """Points of the face that reflects on a grid, in the coordinates of the file."""
    reflector = load_reflector(path, place="auto")
    low, high = reflector.bounds
    pitch = float((high - low)[:2].max()) / FACE_SAMPLES
    x, y = (each.ravel() for each in np.meshgrid(*(np.arange(a + 0.5 * pitch, b, pitch) for a, b in zip(low[:2], high[:2],
                                                                                                       strict=True))))
    points = reflector.surface.points_over(x, y)
    points = points[np.isfinite(points).all(axis=1)]
    return points if reflector.placement is None else reflector.placement.to_file(points)
