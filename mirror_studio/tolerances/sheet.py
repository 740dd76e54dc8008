"""The page of a tolerance study: how the measures spread, and which tolerance brings how much of it."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mirror_studio.explore.replaced import replace_text
from mirror_studio.report.drawing import INK, SMALL, SOFT, WIDTH, Panel, drawing, text
from mirror_studio.report.text import MISSING, count, fixed, number, templates
from mirror_studio.tolerances.file import Tolerances
from mirror_studio.tolerances.statistics import Index, Outcome, Outcomes
from raytrace.measures.registry import registered

BINS = 25
LEFT, MIDDLE, HEIGHT, TOP = 60.0, 470.0, 170.0, 26.0  # px: of the histogram, and where the bars' names begin
NAMES, BAR, APART = 200.0, 13.0, 8.0  # px: of the names of tolerances, and of the bars
BLUE, PALE, LIMIT = "#0072b2", "#9cc7e0", "#b3261e"


@dataclass(frozen=True, slots=True)
class SheetRow:
    """A measure as the table shows it."""

    name: str
    title: str
    unit: str
    designed: str
    mean: str
    sigma: str
    interval: str
    limit: str
    inside: str
    missing: str
    figure: str
    note: str


def write_sheet(path: Path, study: Tolerances, found: Outcomes, mirrors: int) -> None:
    """Write the page, which embeds all it shows.

    Parameters
    ----------
    path : Path
        Of the file.
    study : Tolerances
        What may depart.
    found : Outcomes
        Of its mirrors.
    mirrors : int
        How many.

    Raises
    ------
    WriteError
        Where the file cannot be written.
    """
    where = f" in the scene {study.scene}" if study.scene else ""
    lead = f"{count(mirrors)} mirrors of {study.raw.get('name', 'a design')}{where}, each with its own departures"
    lead += f"; {count(found.failed)} of them could not be made or measured." if found.failed else "."
    page = templates().get_template("tolerances.html.j2").render(
        title=f"Tolerances of {study.raw.get('name', 'a mirror')}", lead=lead, verdict=_verdict(found),
        level=f"{study.file.interval_percent:g}", samples=count(study.file.samples),
        tolerances=[(factor.name, factor.what, factor.size_in_words) for factor in study.factors],
        rows=[_row(name, one, study) for name, one in found.by_measure.items()])
    replace_text(path, page)


def _verdict(found: Outcomes) -> tuple[str, str, str]:
    if found.inside is None or found.inside_interval is None:
        return "open", "No limit is asked for", "[limits] in the study, or in the specification, says what a mirror must meet."
    low, high = (100.0 * end for end in found.inside_interval)
    kind = "yes" if found.inside >= 0.95 else "no" if found.inside < 0.5 else "open"
    return (kind, f"{100.0 * found.inside:.1f} % of the mirrors meet all limits",
            f"So many mirrors tell that share to {low:.1f} to {high:.1f} % (95 %). A mirror that does not show what is limited "
            "does not meet the limit.")


def _row(name: str, one: Outcome, study: Tolerances) -> SheetRow:
    known = registered().get(name)
    title, unit, decimals = (name, "", 3) if known is None else (known.title, known.unit, known.decimals + 1)
    interval = MISSING if one.interval is None else " to ".join(fixed(end, decimals) for end in one.interval)
    limit = "" if one.limit is None else limit_in_words(*one.limit)
    inside = "" if one.inside is None else f"{100.0 * one.inside:.1f} %"
    note = ""
    if not one.indices:
        note = "It does not vary." if one.values.size and not one.missing else "Too few mirrors have it for indices."
    elif one.indices_from < study.file.samples:
        note = (f"Indices from {one.indices_from} of {study.file.samples} samples: {one.missing} mirrors do not have this "
                "figure.")
    figure = "" if not one.values.size or not one.indices else _figure(one, f"{title}, {unit}" if unit else title)
    return SheetRow(name, title, unit, fixed(one.designed, decimals), fixed(one.mean, decimals), number(one.sigma, 2), interval,
                    limit, inside, count(one.missing) if one.missing else "", figure, note)


def limit_in_words(least: float, most: float) -> str:
    """The least and the most that is asked of a measure."""
    if np.isinf(least) and np.isinf(most):
        return "any"
    if np.isinf(most):
        return f"at least {least:g}"
    return f"at most {most:g}" if np.isinf(least) else f"{least:g} to {most:g}"


def _figure(one: Outcome, label: str) -> str:
    """Histogram with interval, design and limits, and beside it a bar a tolerance."""
    height = max(HEIGHT, len(one.indices) * (2.0 * BAR + APART))
    shown = [float(np.quantile(one.values, q)) for q in (0.0005, 0.9995)] + ([] if one.designed is None else [one.designed])
    low, high = min(shown), max(shown)
    margin = 0.04 * (high - low)
    edges = np.linspace(low - margin, high + margin, BINS + 1)
    share = 100.0 * np.histogram(one.values, edges)[0] / one.values.size
    panel = Panel(LEFT, TOP, MIDDLE - LEFT - 40.0, height, (float(edges[0]), float(edges[-1])),
                  (0.0, 1.08 * float(share.max())))
    for end in one.interval or ():
        panel.upright(end, BLUE, 1.4, "6 4")
    for end in one.limit or ():
        if edges[0] < end < edges[-1]:
            panel.upright(end, LIMIT, 1.8)
    if one.designed is not None:
        panel.upright(one.designed, INK, 1.4)
    panel.stairs(edges, share, BLUE)
    parts = [panel.svg(0, "", label, "% of mirrors", note="black: as designed; dashed: interval"
                       + ("; red: limit" if one.limit is not None else ""))]
    return _svg(drawing(TOP + height + 40.0, [*parts, *_bars(one.indices, height)]))


def _bars(indices: object, height: float) -> Sequence[str]:
    assert isinstance(indices, dict)
    start, width = MIDDLE + NAMES, WIDTH - MIDDLE - NAMES - 60.0
    step = height / len(indices)
    parts = [text(start, TOP - 8.0, "share of the variance: dark alone, pale with interactions", SMALL, SOFT)]
    for k in range(5):
        x = start + width * k / 4.0
        parts += [f'<path d="M{x:.1f} {TOP:.1f}v{height:.1f}" stroke="#e4e4e4"/>',
                  text(x, TOP + height + 16.0, f"{0.25 * k:g}", SMALL, SOFT, "middle")]
    ordered: list[tuple[str, Index]] = sorted(indices.items(), key=lambda item: -item[1].total)
    for k, (name, index) in enumerate(ordered):
        top = TOP + (k + 0.5) * step - BAR
        parts.append(text(start - 8.0, top + BAR + 4.0, name, SMALL, INK, "end"))
        for value, interval, colour, y in ((index.first, index.first_interval, BLUE, top),
                                           (index.total, index.total_interval, PALE, top + BAR)):
            ends = [start + width * float(np.clip(end, 0.0, 1.08)) for end in interval]
            long = width * float(np.clip(value, 0.0, 1.08))
            parts += [f'<rect x="{start:.1f}" y="{y:.1f}" width="{long:.1f}" height="{BAR - 1.0:g}" fill="{colour}"/>',
                      f'<path d="M{ends[0]:.1f} {y + 0.5 * BAR:.1f}H{ends[1]:.1f}" stroke="{INK}" stroke-width="1"/>']
    return parts


def _svg(data: bytes) -> str:
    return f"data:image/svg+xml;base64,{base64.b64encode(data).decode()}"
