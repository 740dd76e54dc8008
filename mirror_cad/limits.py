"""The names that [limits] may ask something of: those of mirror_cad itself, and those that others register."""

from __future__ import annotations

_units: dict[str, str] = {}


def allow_limit(name: str, unit: str) -> None:
    """Let specifications limit a figure by its name.

    Parameters
    ----------
    name : as it stands in [limits], lower case with underscores.
    unit : of its two numbers, the least and the most.
    """
    _units[name] = unit


def limit_units() -> dict[str, str]:
    """The figures that may be limited, with their units."""
    return dict(_units)
