"""Say in words which requirements are not met, with the digits that show the miss."""

from __future__ import annotations

import math
from collections.abc import Sequence

from mirror_cad.laws.words import plain
from mirror_studio.report.requirement import Requirement
from mirror_studio.report.rows import actual_in_words


def missed_in_words(rows: Sequence[Requirement]) -> tuple[str, ...]:
    """One sentence for each requirement that is not met, as the terminal says it.

    “k1 …: −4.6413 % at (88.1, −161.1) mm, the limit is 4.641 %”.
    """
    return tuple(_sentence(row) for row in rows if row.met is False)


def _sentence(row: Requirement) -> str:
    limit = f"{plain(row.limit or 0.0)} {row.unit}".strip()
    actual = "not to be measured" if math.isnan(row.actual) else _plain_spaces(actual_in_words(row, sign=row.group == "part"))
    if row.group in ("view", "rules") and row.side != "size":
        return f"{row.name}: {actual}, asked for: at {row.side} {limit}"
    where = "" if row.point is None else f" at ({row.point[0]:.1f}, {row.point[1]:.1f}) mm"
    return f"{row.name}: {actual}{where}, the {'limit' if row.group == 'part' else 'tolerance'} is {limit}"


def _plain_spaces(text: str) -> str:
    """Narrow spaces belong to pages."""
    return text.replace("\u202f", " ").replace("−", "-")
