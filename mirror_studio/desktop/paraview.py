"""Write mirror.vtp and rays.vtp, VTK's polygon files, as ParaView and pyvista read them; and a picture beside."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyvista

from mirror_cad.errors import SpecError, WriteError
from mirror_studio.build.folder import MANIFEST, new_set
from mirror_studio.desktop.sheet import UNITS, Sheet
from mirror_studio.desktop.subject import Fan, Subject

MIRROR, RAYS, PICTURE = "mirror.vtp", "rays.vtp", "view.png"


def mirror_mesh(shown: Sheet) -> pyvista.PolyData:
    """The sheet as PolyData with its fields and normals at the points, and the fields' units under "units"."""
    mesh: Any = pyvista.PolyData(shown.vertices, np.column_stack([np.full(len(shown.faces), 3), shown.faces]).ravel())
    for name, values in shown.fields.items():
        mesh.point_data[name] = values
    mesh.point_data["normals"] = shown.normals
    mesh.point_data.active_normals_name = "normals"
    mesh.field_data["units"] = [f"{name}: {UNITS[name]}" for name in shown.fields]
    mesh.set_active_scalars("Rx")
    return mesh


def ray_lines(fan: Fan) -> pyvista.PolyData:
    """The fan as PolyData: one line a ray, from the eye to the mirror and on; its incidence in degrees on the line."""
    n = len(fan.points)
    nodes = np.stack([np.broadcast_to(fan.eye, (n, 3)), fan.points, fan.ends], axis=1).reshape(-1, 3)
    lines = np.column_stack([np.full(n, 3), np.arange(3 * n).reshape(n, 3)]) if n else np.empty((0, 4), dtype=int)
    mesh = pyvista.PolyData(nodes, lines=lines.ravel())
    mesh.cell_data["incidence_deg"] = fan.incidence_deg
    mesh.point_data["part"] = np.tile(np.array([0, 1, 2]), n)  # eye, mirror, plane
    return mesh


def write_vtp(subject: Subject, target: Path, draw: Callable[[Subject, Path], None] | None = None) -> None:
    """Into a folder, which is replaced as a whole, as MIRROR and RAYS; or as the .vtp file named, with NAME-rays.vtp beside.

    draw : makes a picture too: PICTURE in the folder, or NAME.png beside the file.
    Raises: SpecError for a target that cannot be, WriteError where a file reads back different.
    """
    if target.suffix.lower() == ".vtp":
        if not target.parent.is_dir():
            raise SpecError(f"--vtp {target}: there is no folder {target.parent}")
        _write(subject, target, target.with_name(f"{target.stem}-rays.vtp"))
        if draw is not None:
            draw(subject, target.with_suffix(".png"))
        return
    from mirror_studio.build.pipeline import hashes, write_json

    with new_set(target) as folder:
        _write(subject, folder / MIRROR, folder / RAYS)
        if draw is not None:
            draw(subject, folder / PICTURE)
        write_json(folder / MANIFEST, {"schema": 1, "viewed": subject.name, "files": hashes(folder)})


def _write(subject: Subject, mirror: Path, rays: Path) -> None:
    for path, mesh in ((mirror, mirror_mesh(subject.sheet)), (rays, ray_lines(subject.fan))):
        try:
            mesh.save(path)
        except OSError as error:
            raise WriteError(f"{path}: cannot be written: {error.strerror or error}") from None
        if not path.is_file() or pyvista.read(path).n_points != mesh.n_points:
            raise WriteError(f"{path}: reads back different from what was written")
