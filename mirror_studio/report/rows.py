"""Cells of the tables of requirements, probe points and the change by STEP, as text."""

from __future__ import annotations

import math

from mirror_cad.laws.words import plain
from mirror_studio.report.probe import Probe
from mirror_studio.report.requirement import Requirement
from mirror_studio.report.step_change import StepChange
from mirror_studio.report.text import (
    MISSING,
    NARROW_SPACE,
    decimals_telling,
    digits_telling,
    fixed,
    fixed_with_unit,
    given,
    point_in_words,
    with_unit,
)
from mirror_studio.report.uncertainty import Uncertainty

GROUPS = {"part": "Part: optical face as read back, against the design",
          "view": "View: field of view and lane, as asked for",
          "rules": "Rules of the road: radii and sizes; the official text decides",
          "numerical": "Numerics: each stage against the one before",
          "files": "Files: read back, against the design"}
# What a CAD system shows: a micrometre's thousandth, and of a radius a tenth of a micrometre.
COORDINATE_DECIMALS, NORMAL_DECIMALS, RADIUS_DECIMALS, ANGLE_DECIMALS = 6, 7, 4, 3
VIEW_DECIMALS = 2  # of degrees and percent, as table 1 is compared


def requirement_groups(rows: list[Requirement], measured: Uncertainty) -> list[tuple[str, list[dict[str, str]]]]:
    """The verdict table, group by group: name, limit, actual, margin, place, verdict."""
    return [(title, [_requirement(row, measured) for row in rows if row.group == group]) for group, title in GROUPS.items()]


def probe_rows(probe: Probe) -> list[list[str]]:
    """Number, x, y, z, nx, ny, nz, R1, R2 and the direction of R1, of each point."""
    rows = []
    for k, (point, normal, radii, angle) in enumerate(zip(probe.points, probe.normals, probe.radii, probe.angles_deg,
                                                          strict=True), start=1):
        rows.append([str(k), *(plain(float(value)) for value in point[:2]), fixed(float(point[2]), COORDINATE_DECIMALS),
                     *(fixed(float(value), NORMAL_DECIMALS) for value in normal),
                     *("flat" if math.isinf(radius) else fixed(float(radius), RADIUS_DECIMALS) for radius in radii),
                     fixed(float(angle), ANGLE_DECIMALS)])
    return rows


def change_rows(change: StepChange) -> list[tuple[str, str, str, str]]:
    """Quantity, before, after and difference."""
    return [(row.name, _joined(fixed(row.before, row.decimals), row.unit), _joined(fixed(row.after, row.decimals), row.unit),
             with_unit(row.after - row.before, row.unit, 2, sign=True) if row.unit else fixed(row.after - row.before, 0))
            for row in change.rows]


def _requirement(row: Requirement, measured: Uncertainty) -> dict[str, str]:
    signed = row.group not in ("files", "view", "rules")
    before = {"size": "±" if signed else "", "least": "at least ", "most": "at most "}[row.side]
    verdict = {True: "met", False: "not met", None: "open" if row.ruled == "open" else "no limit"}[row.met]
    key = row.name[:2]
    if row.group == "part" and row.margin is not None and abs(row.margin) < measured.missed(key):
        verdict += ", but closer than the grid tells"
    limit = row.limit if row.limit is None or row.ruled is None else round(row.limit, VIEW_DECIMALS)
    return {
        "name": row.name, "met": {True: "yes", False: "no", None: "open"}[row.met], "verdict": verdict,
        "limit": MISSING if limit is None else before + _asked(limit, row.unit),
        "actual": actual_in_words(row, signed), "margin": MISSING if row.margin is None else _margin(row),
        "place": MISSING if row.point is None or row.actual == 0.0 else
        f"{point_in_words(row.point)}{NARROW_SPACE}mm",
    }


def actual_in_words(row: Requirement, sign: bool) -> str:
    """The actual value, in digits that show on which side of its limit it is."""
    limit, met = row.limit, bool(row.met)
    if math.isinf(row.actual):
        return "flat"
    if row.side != "size":
        decimals = VIEW_DECIMALS if limit is None else decimals_telling(row.size, limit, met, VIEW_DECIMALS)
        return fixed_with_unit(row.actual, row.unit, decimals)
    digits = 3 if limit is None else digits_telling(row.size, limit, met, 3)
    return with_unit(row.actual, row.unit, digits, sign).strip()


def _margin(row: Requirement) -> str:
    margin = row.margin or 0.0
    if math.isinf(margin):
        return MISSING
    if row.side == "size":
        return with_unit(margin, row.unit, 3).strip()
    return fixed_with_unit(margin, row.unit, decimals_telling(margin, 0.0, margin >= 0.0, VIEW_DECIMALS))


def _asked(value: float, unit: str) -> str:
    return given(value, unit) if unit else given(value, "").strip()


def _joined(text: str, unit: str) -> str:
    return f"{text}{NARROW_SPACE}{unit}" if unit else text
