"""Read one uploaded file in a child process with limits on memory and time; its faults come back as an error."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import TYPE_CHECKING

from mirror_cad.errors import FileError

if TYPE_CHECKING:
    from raytrace.reflector import Reflector

MAX_PIXELS = 40_000_000
MAX_FACES = 2_000_000  # of a mesh that is to be traced while sliders move


def read(kind: str, name: str) -> None:
    """Read a file as the studio will, and leave a reflector beside it, ready to be traced. Raises: MirrorError."""
    path = Path(name)
    try:
        _read(kind, path)
    except RecursionError:
        raise FileError(f"{path.name} is nested too deeply") from None


def _read(kind: str, path: Path) -> None:
    if kind == "outline":
        from mirror_cad.outline.files import read_outline

        read_outline(path)
    elif kind == "picture":
        from PIL import Image

        from raytrace.scene.reference import load_picture

        try:
            with Image.open(path) as picture:
                width, height = picture.size
        except Exception:
            width = height = 0  # what is wrong with it, the real reader says
        if width * height > MAX_PIXELS:
            raise FileError(f"{width} × {height} elements are too many (the studio takes {MAX_PIXELS // 10**6} million): "
                            "scale the picture down")
        load_picture(path)
    elif kind == "reflector":
        from raytrace.load import load_reflector

        reflector = load_reflector(path, place="auto")
        if reflector.surface.triangle_count > MAX_FACES:
            raise FileError(f"{reflector.surface.triangle_count} triangles are too many (the studio takes {MAX_FACES // 10**6} "
                            "million): write the mesh coarser")
        _check_size(reflector)
        reflector.surface.prepared()
        path.with_name(f"{path.name}.read").write_bytes(pickle.dumps(reflector))


def _check_size(reflector: Reflector) -> None:
    from mirror_studio.drive.mirrors import LARGEST_MM, SMALLEST_MM
    from raytrace.viewing.view import box_of

    x_min, x_max, y_min, y_max = box_of(reflector)
    size = max(x_max - x_min, y_max - y_min)
    if not SMALLEST_MM <= size <= LARGEST_MM:
        across = f"{1e-3 * size:.4g} m" if size > LARGEST_MM else f"{size:.3g} mm"
        raise FileError(f"your mirror is {across} wide: check its units (a mirror has {SMALLEST_MM:g} mm to "
                        f"{1e-3 * LARGEST_MM:g} m, and a mesh is read in mm)")
