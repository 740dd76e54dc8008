"""The names that [limits] may ask something of: those of mirror_cad itself, and those that others register."""

from __future__ import annotations

from collections.abc import Callable

_units: dict[str, str] = {}
_sources: list[Callable[[], object]] = []


def add_source(source: Callable[[], object]) -> None:
    """Name a function that registers further figures: called once, when a specification names one that is not known."""
    _sources.append(source)


def allow_limit(name: str, unit: str) -> None:
    """Let specifications limit a figure by its name.

    Parameters
    ----------
    name
        As it stands in [limits], lower case with underscores.
    unit
        Of its two numbers, the least and the most.
    """
    _units[name] = unit


def limit_units() -> dict[str, str]:
    """The figures that may be limited, with their units."""
    while _sources:
        _sources.pop()()
    return dict(_units)
