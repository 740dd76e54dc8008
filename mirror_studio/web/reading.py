"""A child process's work: one uploaded file in, read under limits on memory and time; its faults out as JSON."""

from __future__ import annotations

import json
import pickle
import resource
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from mirror_cad.errors import FileError, MirrorError
from mirror_studio.web.uploads import READING_SECONDS

if TYPE_CHECKING:
    from raytrace.reflector import Reflector

MAX_MEMORY = 6_000_000_000  # bytes of address space: the kernel alone maps two
MAX_PIXELS = 40_000_000
MAX_FACES = 2_000_000  # of a mesh that is to be traced while sliders move


def read(kind: str, path: Path) -> None:
    """Read a file as the studio will, and leave a reflector beside it, ready to be traced. Raises: MirrorError."""
    if kind == "outline":
        from mirror_cad.outline_files import read_outline

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
        from raytrace.reflector import load_reflector

        reflector = load_reflector(path, place="auto")
        if reflector.mesh is not None and len(reflector.mesh.faces) > MAX_FACES:
            raise FileError(f"{len(reflector.mesh.faces)} triangles are too many (the studio takes {MAX_FACES // 10**6} "
                            "million): write the mesh coarser")
        _check_size(reflector)
        for spline in reflector.splines:
            _ = spline.trimming
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


def main() -> None:
    """Limits first, then the file."""
    resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY, MAX_MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (READING_SECONDS, READING_SECONDS))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    faults: list[str] = []
    path = Path(sys.argv[2])
    try:
        read(sys.argv[1], path)
    except MirrorError as error:
        faults = str(error).splitlines()
    except MemoryError:
        faults = [f"{path.name} needs too much memory"]
    except RecursionError:
        faults = [f"{path.name} is nested too deeply"]
    print(json.dumps({"faults": faults}))


if __name__ == "__main__":
    main()
