"""A preset's name or a TOML file in, a MirrorSpec out; every fault found is reported at once."""

from __future__ import annotations

import difflib
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from mirror_cad.errors import SpecError
from mirror_cad.spec import MirrorSpec
from mirror_cad.spec_laws import AnyHorizontal, AnyLaw

LARGEST_FILE = 10_000_000  # bytes: a specification is a page of text, a table of 100,000 rows a few megabytes


def preset_names() -> list[str]:
    """The names of the mirrors that come with the package."""
    return sorted(entry.name.removesuffix(".toml") for entry in _designs().iterdir() if entry.name.endswith(".toml"))


def load_spec(name_or_path: str | Path) -> MirrorSpec:
    """Read a specification: the name of a preset, or a TOML file.

    Raises: SpecError with one fault for each unknown, missing, ill-typed or impossible key.
    """
    path = Path(name_or_path)
    if str(name_or_path) in preset_names():
        text, source, folder = (_designs() / f"{name_or_path}.toml").read_text("utf-8"), str(name_or_path), Path(".")
    else:
        text, source, folder = _read_text(path), path.name, path.parent
    try:
        raw = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SpecError(f"{source}: not TOML: {error}") from None
    except RecursionError:
        raise SpecError(f"{source}: nested too deeply to be a specification") from None
    raw.setdefault("name", path.stem)
    return validate_spec(raw, source, folder)


def validate_spec(raw: dict[str, Any], source: str = "specification", folder: Path = Path(".")) -> MirrorSpec:
    """Check a specification given as nested dictionaries; file names in it are relative to `folder`."""
    try:
        return MirrorSpec.model_validate(raw, context={"folder": folder})
    except ValidationError as error:
        details = error.errors(include_url=False)
        raise SpecError([f"{source}: {_sentence(detail, raw)}" for detail in details]) from None


def _designs() -> Any:
    return resources.files("mirror_cad") / "designs"


def _read_text(path: Path) -> str:
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise SpecError(f"{path}: {path.stat().st_size / 1e6:.1f} MB is no specification (at most 10 MB are read)")
        return path.read_text("utf-8-sig")
    except FileNotFoundError:
        near = difflib.get_close_matches(str(path), preset_names(), n=1, cutoff=0.5)
        hint = f"; did you mean the preset {near[0]!r}?" if near else f"; the presets are {', '.join(preset_names())}"
        raise SpecError(f"{path}: no such file or preset{hint}") from None
    except UnicodeDecodeError as error:
        raise SpecError(f"{path}: not a text file (byte {error.start} is no UTF-8): a specification is TOML") from None
    except (OSError, ValueError) as error:
        raise SpecError(f"{path}: cannot be read: {error}") from None


# --- messages --------------------------------------------------------------------------------------------------------

_LAW_UNIONS = {"horizontal": AnyHorizontal, "vertical": AnyLaw}
_PLAIN_TYPES = {
    "float_type": "must be a number", "int_type": "must be a whole number", "string_type": "must be text",
    "int_from_float": "must be a whole number", "finite_number": "must be finite", "tuple_type": "must be a list",
    "model_type": "must be a section", "model_attributes_type": "must be a section", "dict_type": "must be a section",
    "string_pattern_mismatch": "must be letters, digits, '.', '_' and '-' only, up to 64 of them and starting with a "
                               "letter or digit: it names files, so no path",
}


def _sentence(detail: Any, raw: dict[str, Any]) -> str:
    """One validation error as `section.key = value: what is wrong, the allowed range, the nearest name`."""
    keys = [key for i, key in enumerate(detail["loc"]) if not (i == 1 and detail["loc"][0] in _LAW_UNIONS
                                                               and key in _law_models(detail["loc"][0]))]
    where = ".".join(str(key) for key in keys)
    kind, context = detail["type"], detail.get("ctx", {})
    value = detail["input"]
    shown = f"{where} = {_short(value)}" if not isinstance(value, dict) and keys else where
    if kind == "extra_forbidden":
        return f"{where}: {_unknown_key(keys, raw)}"
    if kind == "missing":
        return f"{where}: this key is required{_with_law(keys, raw)}"
    if kind == "union_tag_not_found":
        return f"{where}.law: this key is required: one of {', '.join(_law_models(keys[0]))}"
    if kind == "union_tag_invalid":
        law = context["tag"]
        laws = _law_models(keys[0])
        return f"{where}.law = {_short(law)}: must be one of {', '.join(laws)}{_nearest(law, laws)}"
    if kind == "literal_error":
        words = [word.strip("'") for word in context["expected"].replace(" or ", ", ").split(", ")]
        return f"{shown}: must be one of {context['expected']}{_nearest(value, words)}"
    if kind in ("greater_than", "greater_than_equal", "less_than", "less_than_equal"):
        return f"{shown}: must be {_range(keys, raw, context)}"
    if kind == "value_error":
        message = str(context["error"])
        return message if message.startswith("outline.") else f"{shown}: {message}" if shown else message
    if kind in ("too_short", "too_long", "missing_argument"):
        return f"{shown}: must have {context.get('min_length', context.get('max_length', 'fewer'))} entries"
    return f"{shown}: {_PLAIN_TYPES.get(kind, detail['msg'])}"


def _short(value: Any) -> str:
    text = f'"{value}"' if isinstance(value, str) else repr(value)
    return text if len(text) <= 60 else text[:57] + "…"


def _law_models(section: Any) -> dict[str, type[BaseModel]]:
    union = get_args(get_args(_LAW_UNIONS[str(section)])[0])
    return {get_args(model.model_fields["law"].annotation)[0]: model for model in union}


def _model_at(keys: list[Any], raw: dict[str, Any]) -> type[BaseModel] | None:
    """The model that holds the last of `keys`."""
    model: type[BaseModel] = MirrorSpec
    for key in keys[:-1]:
        if key in _LAW_UNIONS and model is MirrorSpec:
            law = raw[key].get("law") if isinstance(raw.get(key), dict) else None
            found = _law_models(key).get(law) if isinstance(law, str) else None
            if found is None:
                return None
            model = found
            continue
        field = model.model_fields.get(str(key))
        candidates = [field.annotation, *get_args(field.annotation)] if field else []
        nested = [c for c in candidates if isinstance(c, type) and issubclass(c, BaseModel)]
        if not nested:
            return None
        model = nested[0]
    return model


def _range(keys: list[Any], raw: dict[str, Any], context: dict[str, Any]) -> str:
    names = [key for key in keys if not isinstance(key, int)]
    model = _model_at(names, raw)
    field = model.model_fields.get(str(names[-1])) if model else None
    limits = dict(context)
    for mark in field.metadata if field else ():
        limits |= {side: getattr(mark, side) for side in ("gt", "ge", "lt", "le") if hasattr(mark, side)}
    words = {"gt": "above", "ge": "at least", "lt": "below", "le": "at most"}
    return " and ".join(f"{word} {limits[side]:g}" for side, word in words.items() if side in limits)


def _unknown_key(keys: list[Any], raw: dict[str, Any]) -> str:
    model, key = _model_at(keys, raw), str(keys[-1])
    own = list(model.model_fields) if model else []
    if keys[0] in _LAW_UNIONS and len(keys) == 2:
        owners = [law for law, other in _law_models(keys[0]).items() if key in other.model_fields]
        if key == "file":
            owners = ["table"]
        if owners:
            return f"this key belongs to law = {' or '.join(repr(law) for law in owners)}{_with_law(keys, raw)}"
    return f"unknown key{_nearest(key, own)}"


def _with_law(keys: list[Any], raw: dict[str, Any]) -> str:
    if keys[0] not in _LAW_UNIONS or len(keys) < 2:
        return ""
    return f" (the law here is {raw[keys[0]].get('law')!r})"


def _nearest(word: Any, names: Any) -> str:
    names = [str(name) for name in names]
    near = difflib.get_close_matches(str(word), names, n=1, cutoff=0.5)
    return f"; did you mean {near[0]!r}?" if near else f"; known here: {', '.join(names)}" if len(names) <= 14 else ""
