"""The law that a section [horizontal] or [vertical] names, checked by that law's own keys."""

from __future__ import annotations

from collections.abc import Mapping

from pydantic import ValidationError, ValidationInfo
from pydantic_core import InitErrorDetails, PydanticKnownError

from mirror_cad.laws import Law, Matched, registered
from mirror_cad.laws.matched import OPEN, VERTICAL


def horizontal_law(section: object, info: ValidationInfo) -> Law:
    """Check a horizontal law, given as a section's keys or as a law."""
    return section if isinstance(section, Law) else _law(section, dict(info.context or {}))


def vertical_law(section: object, info: ValidationInfo) -> Law:
    """Check a vertical law, which has no key of [horizontal] alone and no number that is solved for."""
    if isinstance(section, Law):
        _refuse({key: getattr(section, key) for key in section.model_fields_set & Law.horizontal_only}, [])
        if isinstance(section, Matched) and section.open:
            raise ValueError(f"{section.open_key} = \"{OPEN}\": only the horizontal law is solved for a field of view")
        return section
    if not isinstance(section, Mapping):
        return _law(section, {})
    foreign = {key: value for key, value in section.items() if key in Law.horizontal_only}
    of_law = {key: value for key, value in section.items() if key not in foreign}
    try:
        law = _law(of_law, dict(info.context or {}) | {VERTICAL: True})
    except ValidationError as error:
        _refuse(foreign, [InitErrorDetails(type=detail["type"], loc=detail["loc"], input=detail["input"],
                                           ctx=detail.get("ctx", {})) for detail in error.errors(include_url=False)])
        raise
    _refuse(foreign, [])
    return law


def _law(section: object, context: dict[str, object]) -> Law:
    if not isinstance(section, Mapping):
        raise PydanticKnownError("dict_type")
    names = ", ".join(registered())
    if "law" not in section:
        raise PydanticKnownError("union_tag_not_found", {"discriminator": "law"})
    kind = registered().get(section["law"]) if isinstance(section["law"], str) else None
    if kind is None:
        raise PydanticKnownError("union_tag_invalid", {"discriminator": "law", "tag": str(section["law"]),
                                                       "expected_tags": names})
    return kind.model_validate(dict(section), context=context)


def _refuse(foreign: Mapping[str, object], others: list[InitErrorDetails]) -> None:
    faults = [InitErrorDetails(type="extra_forbidden", loc=(key,), input=value) for key, value in sorted(foreign.items())]
    if faults:
        raise ValidationError.from_exception_data("law", others + faults)
