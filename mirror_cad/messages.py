"""Say in a sentence what a validation found wrong: what, where, which value, what is allowed, the nearest name."""

from __future__ import annotations

import difflib
import unicodedata
from collections.abc import Iterable, Mapping
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from mirror_cad.limits import limit_units

_PLAIN_TYPES = {
    "float_type": "must be a number", "int_type": "must be a whole number", "string_type": "must be text",
    "bool_type": "must be true or false", "int_from_float": "must be a whole number", "finite_number": "must be finite",
    "tuple_type": "must be a list",
    "model_type": "must be a section", "model_attributes_type": "must be a section", "dict_type": "must be a section",
    "string_pattern_mismatch": "must be letters, digits, '.', '_' and '-' only, up to 64 of them and starting with a "
                               "letter or digit: it names files, so no path",
}


LARGEST_WHOLE = 2**63  # what TOML promises to hold
# Control, format (such as those that turn the direction of writing), surrogate and unassigned; separators of lines.
_UNSEEN = {"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"}


def faults(error: ValidationError | OverflowError, raw: Mapping[str, object], root: type[BaseModel], source: str,
           ) -> list[str]:
    """Say what a validation found wrong, a sentence for every fault.

    Parameters
    ----------
    error : ValidationError or OverflowError
    raw : Mapping
        What was validated.
    root : type
        The model that it was validated by.
    source : str
        What the sentences begin with: a file's name.
    """
    if isinstance(error, OverflowError):
        return [f"{source}: {too_large(raw)}"]
    return [f"{source}: {sentence(detail, raw, root)}" for detail in error.errors(include_url=False)]


def too_large(raw: object, key: str = "") -> str:
    """Name the first whole number beyond what TOML holds, on some of which a validation breaks down; "" for none."""
    if isinstance(raw, dict | list | tuple):
        items = raw.items() if isinstance(raw, dict) else enumerate(raw)
        return next((found for name, value in items if (found := too_large(value, f"{key}.{name}" if key else str(name)))), "")
    if isinstance(raw, int) and abs(raw) > LARGEST_WHOLE:
        digits = int(raw.bit_length() * 0.30103) + 1
        return f"{key}: a whole number of about {digits} digits; no number of a mirror has more than 18"
    return ""


def sentence(detail: ErrorDetails, raw: Mapping[str, object], root: type[BaseModel]) -> str:
    """Say one validation error as `section.key = value: what is wrong, the allowed range, the nearest name`.

    Of what it repeats, a character that cannot be seen is shown as �.

    Parameters
    ----------
    detail : ErrorDetails
        One of `ValidationError.errors()`.
    raw : Mapping
        What was validated.
    root : type
        The model that it was validated by.
    """
    return "".join("\ufffd" if unicodedata.category(letter) in _UNSEEN else letter
                   for letter in _sentence(detail, dict(raw), root))


def _sentence(detail: Any, raw: dict[str, Any], root: type[BaseModel]) -> str:
    keys = list(detail["loc"])
    where = ".".join(str(key) for key in keys)
    kind, context = detail["type"], detail.get("ctx", {})
    value = detail["input"]
    shown = f"{where} = {_short(value)}" if not isinstance(value, dict) and keys else where
    if kind == "extra_forbidden":
        return f"{where}: {_unknown_key(keys, raw, root)}"
    if kind == "missing":
        return f"{where}: this key is required{_with_law(keys, raw, root)}"
    if kind == "union_tag_not_found":
        return f"{where}.law: this key is required: one of {', '.join(_laws(keys, root))}"
    if kind == "union_tag_invalid":
        law, laws = value["law"], _laws(keys, root)
        return f"{where}.law = {_short(law)}: must be one of {', '.join(laws)}{_meant(law, laws)}"
    if kind == "literal_error":
        words = [word.strip("'") for word in context["expected"].replace(" or ", ", ").split(", ")]
        return f"{shown}: must be one of {context['expected']}{_meant(value, words)}"
    if kind in ("greater_than", "greater_than_equal", "less_than", "less_than_equal"):
        return f"{shown}: must be {_range(keys, raw, context, root)}"
    if kind == "value_error":
        message = str(context["error"])
        return message if message.startswith("outline.") else f"{shown}: {message}" if shown else message
    if kind in ("too_short", "too_long", "missing_argument"):
        return f"{shown}: must have {context.get('min_length', context.get('max_length', 'fewer'))} entries"
    return f"{shown}: {_PLAIN_TYPES.get(kind, detail['msg'])}"


def _short(value: Any) -> str:
    text = f'"{value}"' if isinstance(value, str) else repr(value)
    return text if len(text) <= 60 else text[:57] + "…"


def _is_law(key: Any, root: type[BaseModel]) -> bool:
    """Whether a key of the root is a section that names its law (`mirror_cad.laws.base.Law`)."""
    return key in root.model_fields and hasattr(root.model_fields[key].annotation, "known")


def _laws(keys: list[Any], root: type[BaseModel]) -> Mapping[str, type[BaseModel]]:
    """The laws that such a section may name."""
    annotation: Any = root.model_fields[keys[0]].annotation
    found: Mapping[str, type[BaseModel]] = annotation.known
    return found


def _law_of(section: Any) -> Any:
    """The name of the law that a section's keys, or a law made in Python, have."""
    return section.get("law") if isinstance(section, dict) else getattr(section, "law", None)


def _model_at(keys: list[Any], raw: dict[str, Any], root: type[BaseModel]) -> type[BaseModel] | None:
    """The model that holds the last of `keys`."""
    model = root
    for key in keys[:-1]:
        if model is root and _is_law(key, root):
            law = _law_of(raw.get(key))
            found = _laws(keys, root).get(law) if isinstance(law, str) else None
            if found is None:
                return None
            model = found
            continue
        field = _field(model, str(key))
        candidates = [field.annotation, *get_args(field.annotation)] if field else []
        nested = [c for c in candidates if isinstance(c, type) and issubclass(c, BaseModel)]
        if not nested:
            return None
        model = nested[0]
    return model


def _field(model: type[BaseModel], key: str) -> FieldInfo | None:
    """A key's field, which has another name where the key is a word of Python's."""
    return next((field for name, field in model.model_fields.items() if (field.alias or name) == key), None)


def _range(keys: list[Any], raw: dict[str, Any], context: dict[str, Any], root: type[BaseModel]) -> str:
    names = [key for key in keys if not isinstance(key, int)]
    model = _model_at(names, raw, root)
    field = _field(model, str(names[-1])) if model else None
    limits = dict(context)
    for mark in field.metadata if field else ():
        limits |= {side: getattr(mark, side) for side in ("gt", "ge", "lt", "le") if hasattr(mark, side)}
    words = {"gt": "above", "ge": "at least", "lt": "below", "le": "at most"}
    return " and ".join(f"{word} {limits[side]:g}" for side, word in words.items() if side in limits)


def _unknown_key(keys: list[Any], raw: dict[str, Any], root: type[BaseModel]) -> str:
    model, key = _model_at([key for key in keys[:-1] if not isinstance(key, int)] + keys[-1:], raw, root), str(keys[-1])
    own = [field.alias or name for name, field in model.model_fields.items()] if model else []
    if _is_law(keys[0], root) and len(keys) == 2:
        law: Any = root.model_fields[keys[0]].annotation
        if keys[0] == "vertical" and key in law.horizontal_only:
            return "this key belongs to [horizontal]: the vertical law runs over the same t"
        owners = [name for name, other in law.known.items() if key in other.model_fields]
        if owners:
            return f"this key belongs to law = {' or '.join(map(repr, owners))}{_with_law(keys, raw, root)}"
        if keys[0] == "vertical":
            own = [name for name in own if name not in law.horizontal_only]
    return f"unknown key{_nearest(key, [*own, *limit_units()] if keys[0] == 'limits' else own)}"


def _with_law(keys: list[Any], raw: dict[str, Any], root: type[BaseModel]) -> str:
    if len(keys) < 2 or not _is_law(keys[0], root):
        return ""
    return f" (the law here is {_law_of(raw[keys[0]])!r})"


def _meant(word: Any, names: Iterable[str]) -> str:
    """The nearest of names that the sentence lists already."""
    near = difflib.get_close_matches(str(word), list(names), n=1, cutoff=0.5)
    return f"; did you mean {near[0]!r}?" if near else ""


def _nearest(word: Any, names: list[str]) -> str:
    """The nearest name, or all of them where there are few."""
    return _meant(word, names) or (f"; known here: {', '.join(names)}" if len(names) <= 14 else "")
