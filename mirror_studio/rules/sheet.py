"""The lines of a rule beside what was measured of a mirror in, one sheet of paper out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from mirror_studio.report.text import fixed, templates
from mirror_studio.rules.ground import MissingGround
from mirror_studio.rules.measuring import RuleQuantities
from mirror_studio.rules.settings import Adjustment, LoadedField
from mirror_studio.rules.verdicts import RuleLine
from raytrace.viewing.vehicle import HostVehicle

Array = NDArray[np.float64]

CHECKED = {"read": "read", "said": "second hand: check the official text", "memory": "from memory: check the official text"}
DECIMALS = {"mm": 2, "m": 3, "m²": 3, "mm²": 0, "%": 2, "°": 1, "1": 3}
NO_LOADS: Mapping[str, Sequence[LoadedField]] = {}
WIDTH_PX, BORDER_M = 1000.0, 1.0
LEFT_PX, BELOW_PX, X_TICKS = 60.0, 36.0, 9  # for the scales


@dataclass(frozen=True, slots=True)
class SheetTitle:
    """What the sheet is of: a mirror, the class it is taken for, and the scene that it is mounted in, if any."""

    name: str
    class_name: str
    vehicle: str | None


@dataclass(frozen=True, slots=True)
class Row:
    """A line as the table shows it."""

    paragraph: str
    text: str
    measured: str
    value: str
    limit: str
    margin: str
    unit: str
    verdict: str
    checked: str
    notes: tuple[str, ...]


def write_sheet(path: Path, mirror: SheetTitle, measured: RuleQuantities, lines: Sequence[RuleLine],
                adjustment: Adjustment | None = None, loaded: Mapping[str, Sequence[LoadedField]] = NO_LOADS) -> None:
    """Write the page; it embeds all it shows."""
    rule = measured.rule
    fields = [(line.asked.text, plan(line.ground, None if measured.seen is None else measured.seen.mounted.host))
              for line in lines if line.ground is not None]
    facts = [("Rule", f"{rule.title}, {rule.edition}"), ("Class", mirror.class_name),
             ("Wording", rule.wording),
             ("Spherometer", f"outer feet {measured.readings.leg_mm:g} mm apart, on the surface itself"),
             ("Eyes", f"{rule.eyes.separation_mm:g} mm apart ({CHECKED[rule.eyes.checked]}), where the scene "
                      f"{mirror.vehicle!r} has them; the rule: {rule.eyes.above_r_mm:g} mm above R" if mirror.vehicle else
              "no vehicle was given, so no field is measured"),
             *([] if adjustment is None else [("Adjustment", adjustment.words)]),
             *([("Loads", "; ".join(f"{each.words} ({text})" if len(loaded) > 1 else each.words
                                    for text, of in loaded.items() for each in of))] if any(loaded.values()) else []),
             ("Not looked at", f"{_not_looked_at(measured, adjustment, loaded)}edges, mounts and marks")]
    page = templates().get_template("rules.html.j2").render(
        title=f"{mirror.name}: {rule.rule}, class {mirror.class_name}", facts=facts,
        rows=[row_of(line, rule.wording) for line in lines],
        fields=fields)
    path.write_text(page, encoding="utf-8")


def _not_looked_at(measured: RuleQuantities, adjustment: Adjustment | None, loaded: Mapping[str, Sequence[LoadedField]]) -> str:
    """What the scene could have had, and has not."""
    if measured.seen is None:
        return ""
    body = measured.seen.mounted.body
    left = [("pillars and windows", bool(body.opaque or body.windows)),
            ("other settings of the mirror (--adjust-deg)", adjustment is not None),
            ("loads ([[load]] of the scene)", any(loaded.values()))]
    return "".join(f"{what}, " for what, there in left if not there)


def row_of(line: RuleLine, wording: str = "") -> Row:
    """A line in words and rounded figures; margins that rounding would hide keep their digits.

    wording : what stands above the lines already, and is not said again.
    """
    asked, decimals = line.asked, DECIMALS[line.asked.unit]
    least, most = (end if np.isfinite(end) else None for end in line.limit)
    least = least if least != 0.0 or most is None else None  # sizes and shares have no less
    ends = " to ".join(fixed(end, _digits(end)) for end in (least, most) if end is not None)
    if line.limit == (np.inf, np.inf):
        limit = "flat"
    elif least is not None and most is not None:
        limit = ends
    else:
        limit = f"≥ {ends}" if least is not None else f"≤ {ends}" if most is not None else "–"
    paragraph = asked.paragraph + ("" if asked.paragraph_checked == "read" else " (?)")
    return Row(paragraph, asked.text, asked.measured, fixed(line.value, _fine(line, decimals)), limit,
               fixed(line.margin, _fine(line, decimals), sign=True), asked.unit if asked.unit != "1" else "", line.verdict,
               CHECKED[asked.checked],
               tuple("left open by the wording above" if note == wording else note for note in line.notes))


def _digits(value: float) -> int:
    return 0 if float(value).is_integer() else 2


def _fine(line: RuleLine, decimals: int) -> int:
    """Decimals in which a margin other than 0 is seen to be one."""
    if line.margin in (None, 0.0):
        return decimals
    return max(decimals, min(9, 1 - int(np.floor(np.log10(abs(line.margin or 1.0))))))


def plan(found: MissingGround, host: HostVehicle | None = None) -> Markup:
    """The ground in plan as SVG: what is asked for, what is seen of it, and what is missing. X to the right, Y downwards.

    With a scale in metres along the field and across it, and the vehicle's outline where that lies in the drawing.
    """
    low, high = found.required.min(axis=0) / 1e3 - BORDER_M, found.required.max(axis=0) / 1e3 + BORDER_M
    if host is not None:  # the flank that the field begins at
        low[1], high[1] = min(low[1], -host.half_width_mm / 1e3 - BORDER_M), max(high[1], host.half_width_mm / 1e3 + BORDER_M)
    scale = (WIDTH_PX - LEFT_PX) / (high[0] - low[0])
    height = scale * (high[1] - low[1])

    def at(points: Array) -> Array:
        # Seen ground goes far beyond the drawing, whose frame cuts it.
        result: Array = (np.clip(points / 1e3, low - 10.0, high + 10.0) - low) * scale + [LEFT_PX, 0.0]
        return result

    def shape(polygon: Array, style: str) -> str:
        return f'<polygon points="{" ".join(f"{x:.2f},{y:.2f}" for x, y in at(polygon))}" style="{style}"/>'

    shapes = [*(shape(polygon, "fill:#bcd7c4") for polygon in found.seen),
              *(shape(polygon, "fill:#c43d3d") for polygon in found.missing),
              shape(found.required, "fill:none;stroke:#1d2329;stroke-width:2")]
    if host is not None:
        x, y = (host.front_mm, host.rear_mm), (-host.half_width_mm, host.half_width_mm)
        box = np.array([[x[0], y[0]], [x[1], y[0]], [x[1], y[1]], [x[0], y[1]]])
        shapes.insert(0, shape(box, "fill:#e6e9ec;stroke:#9aa5ae"))
    middle = float(at(np.zeros((1, 2)))[0, 1])
    axis = (f'<line x1="{LEFT_PX:g}" y1="{middle:.2f}" x2="{WIDTH_PX:g}" y2="{middle:.2f}" '
            'style="stroke:#9aa5ae;stroke-dasharray:6 6"/>')
    text = 'style="font:18px sans-serif;fill:#5a6573"'
    ticks = []
    for value in _ticks(low[0], high[0], X_TICKS):
        x_px = float(at(np.array([[1e3 * value, 0.0]]))[0, 0])
        anchor = "end" if x_px > WIDTH_PX - LEFT_PX / 2.0 else "middle"  # the last number stays in the picture
        ticks.append(f'<line x1="{x_px:.2f}" y1="{height:.2f}" x2="{x_px:.2f}" y2="{height + 7.0:.2f}" style="stroke:#5a6573"/>'
                     f'<text x="{x_px:.2f}" y="{height + 28.0:.2f}" text-anchor="{anchor}" {text}>{_number(value)}</text>')
    for value in _ticks(low[1], high[1], max(2, int(height / 60.0))):
        y_px = float(at(np.array([[0.0, 1e3 * value]]))[0, 1])
        ticks.append(f'<line x1="{LEFT_PX - 7.0:.2f}" y1="{y_px:.2f}" x2="{LEFT_PX:.2f}" y2="{y_px:.2f}" '
                     'style="stroke:#5a6573"/>'
                     f'<text x="{LEFT_PX - 11.0:.2f}" y="{y_px + 8.0:.2f}" text-anchor="end" {text}>{_number(value)}</text>')
    frame = f"frame-{height:.0f}"  # of its own, where a page has several
    clip = (f'<clipPath id="{frame}"><rect x="{LEFT_PX:g}" y="0" width="{WIDTH_PX - LEFT_PX:g}" height="{height:.1f}"/>'
            '</clipPath>')
    return Markup(f'<svg viewBox="0 0 {WIDTH_PX:g} {height + BELOW_PX:.1f}" role="img" aria-label="Required ground in plan">'
                  f'{clip}<g clip-path="url(#{frame})">' + "".join(shapes) + axis + "</g>" + "".join(ticks) + "</svg>")


def _ticks(low: float, high: float, parts: int) -> Array:
    """Round values between two ends, some `parts` of them."""
    raw = (high - low) / max(parts, 1)
    power = 10.0 ** np.floor(np.log10(raw))
    step = power * next(m for m in (1.0, 2.0, 5.0, 10.0) if m * power >= raw)
    result: Array = step * np.arange(np.ceil(low / step), np.floor(high / step) + 1.0)
    return result


def _number(value: float) -> str:
    return f"{value:.10g}".replace("-", "−")
