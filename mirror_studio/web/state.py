"""Specifications as the page holds them, to checked ones and TOML and back; the presets; the controls of the page."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from mirror_cad.errors import SpecError
from mirror_cad.spec import MirrorSpec
from mirror_cad.spec.file import load_spec, preset_names, spec_as_json, validate_spec
from mirror_studio.web.protocol import ViewSettings
from mirror_studio.web.rules import check_offered
from mirror_studio.web.uploads import NAME, Uploads

OPENS_ON = "progressive-c"
LOOK_LINE = "# studio: "  # before what a specification has no key for, as JSON, in a TOML file's first line
OF_THE_PAGE = {"width", "height", "own"}  # of a look: what belongs to one window, or to files that are not the specification's
FILES = (("outline", "file"), ("scene", "image"))
BUILT_IN_PICTURE = "road"


def presets() -> dict[str, dict[str, Any]]:
    """Every preset with all of its keys, as the page holds them."""
    return {name: as_state(load_spec(name)) for name in preset_names()}


def as_state(spec: MirrorSpec) -> dict[str, Any]:
    """A specification with all of its keys, without what is left out.

    An infinite radius is the text "inf", a side of a limit that is free is None, a file its name. Where the surface comes from
    a view and laws are left out, those that the page opens with are there to go back to.
    """
    state = spec_as_json(spec)
    if "horizontal" not in state or "vertical" not in state:
        opens_on = spec_as_json(load_spec(OPENS_ON))
        state = {law: opens_on[law] for law in ("horizontal", "vertical")} | state
    for section, key in FILES:
        if key in state[section] and state[section][key] != BUILT_IN_PICTURE:
            state[section][key] = Path(state[section][key]).name
    for key, value in state["limits"].items():
        if isinstance(value, list):  # JSON has no infinite number
            state["limits"][key] = [end if isinstance(end, float) else None for end in value]
    return state


def as_look(look: ViewSettings) -> dict[str, Any]:
    """How a design is looked at, with all of its keys, as the page holds it."""
    return look.model_dump(exclude=OF_THE_PAGE)


NO_SPHERE = ("two radii make no sphere: this is the decoupled surface of both laws, until they are constant and of one radius "
             "again, or another method is chosen")


def no_sphere(state: Mapping[str, Any]) -> bool:
    """Whether the page holds a sphere of which one law was changed: `as_spec` then takes the decoupled surface instead."""
    across, upright, surface = (state.get(name) for name in ("horizontal", "vertical", "surface"))
    if not (isinstance(surface, dict) and surface.get("method") == "sphere"
            and isinstance(across, dict) and isinstance(upright, dict)):
        return False
    # Only a law of one radius everywhere has this key.
    return any(across.get(key) != upright.get(key) or key not in across for key in ("law", "radius_mm"))


def as_spec(state: dict[str, Any], uploads: Uploads) -> MirrorSpec:
    """What the page holds, checked as any specification; one law of a sphere may be dragged (`no_sphere`).

    Raises: SpecError with every fault, and for files not uploaded.
    """
    if no_sphere(state):
        state = state | {"surface": state["surface"] | {"method": "decoupled"}}
    surface = state.get("surface")
    if isinstance(surface, dict) and surface.get("method") == "view":  # the laws are there to go back to, and no part of it
        state = {section: keys for section, keys in state.items() if section not in ("horizontal", "vertical")}
    return _checked(state, uploads)


def _checked(state: dict[str, Any], uploads: Uploads) -> MirrorSpec:
    raw = {name: dict(section) if isinstance(section, dict) else section for name, section in state.items()}
    for law in ("horizontal", "vertical"):
        section = raw.get(law)
        if isinstance(section, dict) and "file" in section:
            raise SpecError(f"{law}.file = {str(section['file'])[:60]!r}: the studio reads no files by their names: bring "
                            "the table in with \"Table from CSV\"")
    target = raw.get("target")
    if isinstance(target, dict):
        for where, section in (("target", target), ("target.weight", target.get("weight"))):
            if isinstance(section, dict) and section.get("file") is not None:
                raise SpecError(f"{where}.file = {str(section['file'])[:60]!r}: the studio reads no files by their names: "
                                "write its table into the specification")
    limits = raw.get("limits")
    if isinstance(limits, dict):
        for key, value in limits.items():
            if isinstance(value, list) and len(value) == 2:
                limits[key] = [free if end is None else end for end, free in zip(value, (-math.inf, math.inf), strict=True)]
    for where, key in FILES:
        section = raw.get(where)
        name = section.get(key) if isinstance(section, dict) else None
        if isinstance(name, str) and NAME.fullmatch(name) and not uploads.has(name):
            raise SpecError(f"{where}.{key}: its file is no longer here, and the studio reads no files by their names: bring "
                            "it in again with its button")
        if name is not None and name != BUILT_IN_PICTURE and not uploads.has(name):
            raise SpecError(f"{where}.{key} = {str(name)[:60]!r}: the studio reads no files by their names: bring this one in "
                            "with its button")
    rules = raw.get("rules")
    if isinstance(rules, dict) and "rule" in rules:
        check_offered(rules["rule"])
    return validate_spec(raw, "specification", uploads.folder)


def read_toml(text: str, uploads: Uploads) -> tuple[dict[str, Any], dict[str, Any] | None]:
    """A TOML file's specification as the page holds it, and its first line's look, if it has one.

    Raises: SpecError for a text that is no specification, or names files.
    """
    try:
        raw = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise SpecError(f"specification: not TOML: {str(error)[:200]}") from None
    raw.setdefault("name", "mirror")
    look = None
    if text.startswith(LOOK_LINE):
        try:
            look = as_look(ViewSettings.model_validate_json(text.split("\n", 1)[0].removeprefix(LOOK_LINE)))
        except ValidationError:
            look = None  # a comment of somebody else's
    return as_state(_checked(raw, uploads)), look


def files_of(spec: MirrorSpec, uploads: Uploads) -> list[str]:
    """The names of the uploaded files that a specification uses."""
    names = (Path(str(getattr(getattr(spec, section), key))).name for section, key in FILES)
    return [name for name in names if uploads.has(name)]


def as_toml(spec: MirrorSpec, look: ViewSettings | None = None, files: Mapping[str, str] | None = None) -> str:
    """A specification as TOML, without the keys that have their defaults; files by their names alone.

    files : what to call uploaded ones.
    """
    content = spec.model_dump(mode="python", exclude_defaults=True, exclude_none=True, warnings=False)
    if not spec.has_laws:
        content = {section: keys for section, keys in content.items() if section not in ("horizontal", "vertical")}
    content = {"name": spec.name} | content
    for section, key in FILES:
        if key in content.get(section, {}) and content[section][key] != BUILT_IN_PICTURE:
            name = Path(content[section][key]).name
            content[section][key] = (files or {}).get(name, name)
    lines = [] if look is None else [LOOK_LINE + look.model_dump_json(exclude=OF_THE_PAGE, exclude_defaults=True)]
    _write(lines, (), content)
    return "\n".join(lines) + "\n"


def _write(lines: list[str], path: tuple[str, ...], table: dict[str, Any]) -> None:
    if path:
        lines += ["", f"[{'.'.join(path)}]"]
    lines += [f"{key} = {_value(value)}" for key, value in table.items() if not isinstance(value, dict)]
    for key, value in table.items():
        if isinstance(value, dict):
            _write(lines, (*path, key), value)


def _value(value: Any) -> str:
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value)
