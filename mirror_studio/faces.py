"""List the faces of a CAD file: what there is for `--face` to choose from."""

from __future__ import annotations

import json
from pathlib import Path

from mirror_cad.cad_file import CadFace, read_cad
from mirror_studio.progress import Progress
from raytrace.errors import TraceError
from raytrace.file_kinds import CAD_KINDS

HEADINGS = ("face", "area mm²", "surface", "colour", "name", "part", "layer")


def print_faces(path: Path, as_json: bool) -> None:
    """Print a line a face: number, area, surface, colour, name, parts and layers; or the same as JSON.

    Raises: TraceError for a file of another kind, FileError for one that cannot be read.
    """
    if path.suffix.lower() not in CAD_KINDS:
        raise TraceError(f"{path}: faces are listed of {', '.join(CAD_KINDS)} files; a mesh has none to choose from")
    file = read_cad(path, areas=True, progress=Progress().share)
    if as_json:
        print(json.dumps({"faces": [_as_json(face) for face in file.faces], "lost_faces": list(file.lost),
                          "missing_files": list(file.missing)}, indent=2,
                         ensure_ascii=False))
        return
    rows = [HEADINGS, *(_row(face) for face in file.faces)]
    widths = [max(len(row[k]) for row in rows) for k in range(len(HEADINGS))]
    for row in rows:
        print("  ".join(text.ljust(width) if k > 1 else text.rjust(width)
                        for k, (text, width) in enumerate(zip(row, widths, strict=True))).rstrip())
    if file.lost:
        print(f"Faces that the kernel cannot make: {', '.join(name or 'one without a name' for name in file.lost)}")
    if file.missing:
        print(f"Parts in files that are not beside it: {', '.join(file.missing)}")


def _colour(face: CadFace) -> str | None:
    return None if face.colour is None else "#{:02x}{:02x}{:02x}".format(*face.colour)


def _row(face: CadFace) -> tuple[str, ...]:
    return (str(face.number), "" if face.area_mm2 is None else f"{face.area_mm2:.6g}", face.surface, _colour(face) or "-",
            face.name or "-", " / ".join(face.parts) or "-", ", ".join(face.layers) or "-")


def _as_json(face: CadFace) -> dict[str, object]:
    return {"number": face.number, "area_mm2": face.area_mm2, "surface": face.surface, "colour": _colour(face),
            "name": face.name, "parts": list(face.parts), "layers": list(face.layers)}
