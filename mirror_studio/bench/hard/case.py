"""What a case is made of: what is hard and the work, the figures that come out, or the refusal that has to."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from mirror_cad.errors import MirrorError


@dataclass(frozen=True, slots=True)
class Figure:
    """One comparison: |value| may not pass the tolerance, which has a reason."""

    what: str
    value: float
    tolerance: float
    unit: str
    reason: str

    @property
    def share(self) -> float:
        """|value| as a share of the tolerance."""
        if self.tolerance == 0.0:
            return 0.0 if self.value == 0.0 else math.inf
        return abs(self.value) / self.tolerance


@dataclass(frozen=True, slots=True)
class Refusal:
    """The error that a case has to end with, and the words of its message that name the cause."""

    kind: type[MirrorError]
    words: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """What is hard, and the work: a folder for files in, figures out. Where a refusal is expected, it is right alone."""

    name: str
    hard: str
    run: Callable[[Path], Sequence[Figure]]
    refusal: Refusal | None = None
