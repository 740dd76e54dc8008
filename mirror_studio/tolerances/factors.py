"""What of a mirror is drawn at random: a share from 0 to 1 in, a departure, an angle or a draw out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from scipy.special import ndtri


@dataclass(frozen=True, slots=True)
class RandomQuantity:
    """A random quantity of a row.

    Attributes
    ----------
    name : str
        In rows.csv.
    kind : str
        `normal`, of the sigma `size` about 0; `centred`, uniform from −size to size; `from 0`, uniform from 0 to size.
    size : float
        In the unit that the name ends in.
    """

    name: str
    kind: Literal["normal", "centred", "from 0"]
    size: float

    def at(self, share: float) -> float:
        """The value below which that share of all lies."""
        if self.kind == "normal":
            return self.size * float(ndtri(share))
        return self.size * (2.0 * share - 1.0 if self.kind == "centred" else share)


@dataclass(frozen=True, slots=True)
class Factor:
    """A tolerance: what may vary by itself.

    Attributes
    ----------
    name : str
        In tables.
    columns : tuple of RandomQuantity
        What is drawn for it.
    what : str
        Of the design, in words.
    """

    name: str
    columns: tuple[RandomQuantity, ...]
    what: str

    @property
    def size_in_words(self) -> str:
        """How far it goes."""
        column = self.columns[0]
        if column.kind == "normal":
            return f"sigma {column.size:g}"
        return f"within ±{column.size:g}" if column.kind == "centred" else "at random"


def departure(name: str, sigma: float | None, within: float | None) -> RandomQuantity:
    """Normally distributed, or anywhere within so much to either side."""
    return RandomQuantity(name, "normal", sigma) if sigma is not None else RandomQuantity(name, "centred", within or 0.0)


def angle(name: str, degrees: float) -> RandomQuantity:
    """Any angle from 0 to so many degrees."""
    return RandomQuantity(name, "from 0", degrees)


def draw(name: str) -> RandomQuantity:
    """A number that a random map is drawn by."""
    return RandomQuantity(name, "from 0", 1.0)
