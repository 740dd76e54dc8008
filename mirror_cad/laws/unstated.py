"""The law of a mirror that has none, because its surface comes from the wanted view."""

from __future__ import annotations

from typing import Literal

from mirror_cad.laws.base import Law


class Unstated(Law):
    """No law: what stands for [horizontal] and [vertical] where they are left out. No file can name it."""

    law: Literal["none"] = "none"

    def in_words(self, solved: float | None = None) -> str:
        """Say that there is none, and why."""
        return "none: the surface comes from the wanted view"

    def in_short(self) -> str:
        """Say what stands in its place."""
        return "wanted view"
