"""The front of a study for the page: its designs, what its columns are, and the specification to put their values into."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mirror_cad.errors import FileError
from mirror_cad.spec import MirrorSpec
from mirror_cad.spec.file import validate_spec
from mirror_studio.explore.front import Front
from mirror_studio.json_types import Json
from mirror_studio.web.state import BUILT_IN_PICTURE, FILES, as_state
from mirror_studio.web.uploads import Kind, Uploads

KINDS: dict[str, Kind] = {"outline": "outline", "scene": "picture"}  # of the files that a specification names, by its section


def front_as_json(front: Front, folder: Path | None, uploads: Uploads) -> dict[str, Json]:
    """A front as the page holds it.

    Parameters
    ----------
    front
        The front.
    folder
        What files in its specification are relative to, where the studio was told of it; those of one that a page sends are
        not read.
    uploads
        Where such files go.

    Raises
    ------
    MirrorError
        For a specification that cannot be, or whose files cannot be read.
    """
    from raytrace.measures.registry import registered

    known = registered()
    measures: list[Json] = []
    for name in front.measures:
        one = known.get(name)
        measures.append({"name": name, "title": name if one is None else one.title, "unit": "" if one is None else one.unit,
                         "decimals": 3 if one is None else one.decimals, "definition": name if one is None else one.definition})
    spec = None
    if front.spec is not None:
        raw = _with_uploads(front.spec, folder, uploads) if folder is not None else front.spec
        spec = as_state(validate_spec(raw, front.name, uploads.folder))
    return {"name": front.name, "keys": list(front.keys), "measures": measures, "objectives": list(front.objectives),
            "scene": front.scene, "values": [list(row) for row in front.values],
            "figures": [list(row) for row in front.figures], "spec": spec}


def _with_uploads(raw: dict[str, Any], folder: Path, uploads: Uploads) -> dict[str, Any]:
    """The specification with its files brought in, by their names there."""
    spec: MirrorSpec = validate_spec(raw, "specification", folder)
    changed = dict(raw)
    for section, key in FILES:
        name = getattr(getattr(spec, section), key)
        if name is None or name == BUILT_IN_PICTURE:
            continue
        path = folder / str(name)
        try:
            data = path.read_bytes()
        except OSError as error:
            raise FileError(f"{path}: cannot be read: {error.strerror or error}") from None
        changed[section] = raw[section] | {key: uploads.add(KINDS[section], path.suffix.lower(), data, path.name)}
    return changed
