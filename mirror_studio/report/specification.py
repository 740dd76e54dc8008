"""The keys that a mirror was made by and their values, as a report lists them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mirror_cad.laws.words import plain
from mirror_cad.spec import MirrorSpec
from mirror_studio.report.text import SMALLEST_PLAIN, number

SIZES = {"width_mm", "left_height_mm", "right_height_mm", "corner_radius_mm"}


def specification_rows(spec: MirrorSpec) -> list[list[tuple[str, str]]]:
    """Pairs of rows to stand side by side, each a key and its value: what is not set or has no effect is left out."""
    return _paired(_flat(in_effect(spec)))


def in_effect(spec: MirrorSpec) -> dict[str, Any]:
    """A specification without the keys that have no effect beside others.

    An outline file replaces the sizes, glass before nothing has no index, the kernel's fits choose their own degree and spans.
    """
    found = spec.model_dump()
    if spec.outline.file is not None:
        found["outline"] = {key: value for key, value in found["outline"].items() if key not in SIZES}
    if spec.glass.reflecting == "front":
        del found["glass"]["index"]
    if not spec.has_laws:
        del found["horizontal"], found["vertical"]
    if spec.surface.fit != "collocation":
        del found["surface"]["degree"], found["surface"]["spans"]
    return found


def _flat(section: Mapping[str, Any], before: str = "") -> list[tuple[str, str]]:
    """Keys and values of a specification, as `horizontal.law` and “zones”; what is not set is left out."""
    rows: list[tuple[str, str]] = []
    for key, value in sorted(section.items(), key=lambda item: item[0] != "law"):
        if isinstance(value, Mapping):
            rows += _flat(value, f"{before}{key}.")
        elif isinstance(value, tuple | list) and len(value) > 8:
            rows.append((before + key, f"{len(value)} values, {_value(value[0])} to {_value(value[-1])}"))
        elif value is not None:
            rows.append((before + key, _value(value)))
    return rows


def _paired(rows: list[tuple[str, str]]) -> list[list[tuple[str, str]]]:
    """Two rows side by side: the first half of them on the left."""
    half = (len(rows) + 1) // 2
    right = [*rows[half:], *([("", "")] if len(rows) % 2 else [])]
    return [[left, beside] for left, beside in zip(rows[:half], right, strict=True)]


def _value(value: Any) -> str:
    if isinstance(value, tuple | list):
        return ", ".join(_value(each) for each in value)
    if isinstance(value, float):
        return plain(value).replace("inf", "∞") if value == 0.0 or abs(value) >= SMALLEST_PLAIN else number(value)
    return str(value)
