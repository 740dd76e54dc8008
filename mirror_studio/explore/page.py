"""A study's rows in, one page that shows them out: parallel axes, a scatter matrix and a table, brushed together."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from mirror_cad.spec.file import load_spec, preset_names, spec_as_json
from mirror_studio.explore.evaluate import Row
from mirror_studio.explore.replaced import replace_text
from mirror_studio.explore.study import Study
from mirror_studio.report.text import templates
from raytrace.measures.registry import registered

PAGE = "study.html"
MAX_AXES = 9  # shown to begin with: more do not fit beside each other


def write_page(path: Path, study: Study, rows: Sequence[Row], front: Sequence[Row] = (),
               settled: Sequence[tuple[int, float]] = (), settled_title: str = "", settled_text: str = "") -> None:
    """Write a page that embeds all it shows.

    Parameters
    ----------
    path : Path
    study : Study
    rows : sequence of Row
    front : sequence of Row
        Those of them that no other beats.
    settled : sequence of (int, float)
        Hypervolume, or the best figure, over evaluations.
    settled_title, settled_text : str
        What that is, and what else says how far the search is from settled.

    Raises
    ------
    WriteError
        Where the file cannot be written.
    """
    columns, data = _columns(study, rows)
    causes = {cause: k for k, cause in enumerate(dict.fromkeys(row.cause for row in rows if row.status != "ok"), 1)}
    at = {row.index: k for k, row in enumerate(rows)}
    preset, differs = _from_preset(study.raw)
    head = {"rows": len(rows), "columns": columns, "causes": list(causes), "front": [at[row.index] for row in front],
            "numbers": None if all(row.index == k for k, row in enumerate(rows)) else [row.index for row in rows],
            "settled": [list(one) for one in settled], "settledTitle": settled_title,
            "studio": {"preset": preset, "differs": differs}, "lists": _lists(study)}
    failed = len(rows) - sum(row.status == "ok" for row in rows)
    where = f" in the scene {study.scene}" if study.scene else ""
    said = [f"{len(rows)} designs of {study.raw.get('name', 'a mirror')}{where}"]
    said += [f"{failed} could not be made"] * (failed > 0) + [f"{len(front)} on the front"] * bool(front)
    lead = "; ".join(said) + "."
    codes = np.array([causes.get(row.cause, 0) if row.status != "ok" else 0 for row in rows], dtype="<u2")
    script = (resources.files("mirror_studio.explore") / "static" / "study.js").read_text(encoding="utf-8")
    text = templates().get_template("study.html.j2").render(
        title=path.parent.name, lead=lead, settled_text=settled_text, front=bool(front),
        head=Markup(_in_script(json.dumps(head, ensure_ascii=False, allow_nan=False))),
        data=Markup(_base64(data)), cause=Markup(_base64(codes)), script=Markup(script))
    replace_text(path, text)


def _columns(study: Study, rows: Sequence[Row]) -> tuple[list[dict[str, Any]], np.ndarray[Any, np.dtype[np.float64]]]:
    """What each column is, and all of its numbers, column by column: of texts their places in a list of words."""
    known = registered()
    columns: list[dict[str, Any]] = []
    data = np.full((len(study.keys) + len(study.measures), len(rows)), np.nan)
    for k, key in enumerate(study.keys):
        values = [row.values[k] for row in rows]
        column: dict[str, Any] = {"name": key, "title": key, "unit": "", "measure": False}
        if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
            data[k] = values
        else:
            words = list(dict.fromkeys(str(value) for value in values))
            column["words"] = words
            data[k] = [words.index(str(value)) for value in values]
        columns.append(column)
    for k, name in enumerate(study.measures):
        measure = known.get(name)
        columns.append({"name": name, "title": name if measure is None else measure.title, "measure": True,
                        "unit": "" if measure is None else measure.unit,
                        "definition": name if measure is None else f"{name}: {measure.definition}"})
        data[len(study.keys) + k] = [np.nan if row.figures[k] is None else row.figures[k] for row in rows]
    # Measures first, for which the study was made; then as many keys as there is room for.
    for place, column in enumerate(sorted(columns, key=lambda one: not one["measure"])):
        column["on"] = place < MAX_AXES
    return columns, data


def _from_preset(raw: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    """The preset that a specification differs least from, and its keys that do: null for one that it has not."""
    own = _flat(raw)
    found: list[tuple[int, str, dict[str, Any]]] = []
    for name in preset_names():
        preset = _flat(spec_as_json(load_spec(name)))
        differs = {key: value for key, value in own.items() if key not in preset or preset[key] != value}
        differs |= {key: None for key in preset if key not in own}
        found.append((len(differs), name, differs))
    _, name, differs = min(found, key=lambda one: one[:2])
    return name, differs


def _flat(values: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, dict):
            found |= _flat(value, f"{prefix}{key}.")
        else:
            found[prefix + key] = value
    return found


def _lists(study: Study) -> dict[str, list[Any]]:
    """The lists of the specification of which an entry is varied."""
    own = _flat(study.raw)
    found = {}
    for key in study.keys:
        whole, _, entry = key.rpartition(".")
        if entry.isdecimal() and isinstance(own.get(whole), list | tuple):
            found[whole] = list(own[whole])
    return found


def _in_script(text: str) -> str:
    return text.replace("<", "\\u003c")


def _base64(values: np.ndarray[Any, Any]) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode("ascii")
