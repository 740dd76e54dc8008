"""The report of a made mirror, one page that embeds all it shows."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from pathlib import Path

from mirror_cad.curvature_fields import QUANTITIES
from mirror_cad.laws.words import plain
from mirror_cad.made.figures import Figure, Figures
from mirror_cad.made.hidden_form import HiddenForm
from mirror_cad.made.inspection import Inspection
from mirror_cad.made.verdict import Verdict
from mirror_studio.inspect.curves import histograms_figure, sections_figure
from mirror_studio.inspect.driver import DriversView
from mirror_studio.inspect.pictures import curvature_maps, form_maps, hidden_maps, sigma_maps, turn_maps
from mirror_studio.inspect.probes import probe_places
from mirror_studio.report.text import MISSING, count, fixed, number, point_in_words, templates

UNKNOWN_IN_WORDS = "not known"


@dataclass(frozen=True, slots=True)
class Row:
    """A quantity as the table of figures shows it."""

    name: str
    unit: str
    largest: str
    interval: str
    at: str
    rms: str
    sigma: str


@dataclass(frozen=True, slots=True)
class SeenRow:
    """A measure as the table of what the driver sees shows it."""

    name: str
    unit: str
    designed: str
    measured: str
    interval: str


def write_sheet(path: Path, title: str, facts: list[tuple[str, str]], found: Inspection, figures: Figures,
                verdict: Verdict | None, view: DriversView | None, hidden: HiddenForm, notes: tuple[str, ...]) -> None:
    """Write the page.

    Parameters
    ----------
    path : Path
        Of the file.
    title : str
        Of the page.
    facts : list of tuple
        Names and texts of what the report stands on.
    found, figures, verdict, view, hidden
        What it reports.
    notes : tuple of str
        What a user should know.
    """
    pictures = [(png_uri(form_maps(found)), "Measured minus designed after alignment, along z: height, and the angle between "
                                            "the normals, each with its sigma. Grey: not measured.")]
    if found.fields.known.any():
        pictures += [(png_uri(curvature_maps(found)),
                      f"Deviation of curvature over a gauge of {plain(found.fields.gauge_mm)} mm, convex positive. Grey: there "
                      "the whole gauge does not stand on the mirror and on measured points; what is left of its disc tells "
                      "less, and is in the table of maps with its larger sigma."),
                     (png_uri(sigma_maps(found)), "How sure that is: one sigma.")]
    seen = [] if view is None else [SeenRow(
        each.title, each.unit, fixed(each.designed, each.decimals), fixed(each.measured, each.decimals),
        MISSING if each.interval is None else " to ".join(fixed(end, each.decimals) for end in each.interval))
        for each in view.measures]
    shown = None if view is None else [(_jpeg(view.designed_jpeg), "As designed"), (_jpeg(view.measured_jpeg), "As measured")]
    turns = None if view is None else png_uri(turn_maps(found, view.turn, view.turn_sigma))
    page = templates().get_template("inspect.html.j2").render(
        title=title, facts=facts, verdict=verdict_in_words(verdict, found), rows=rows(figures, found.fields.flat),
        pictures=pictures, notes=notes, seen=seen, shown=shown, turns=turns, gauge=plain(found.fields.gauge_mm),
        sections=svg_uri(sections_figure(found)), histograms=svg_uri(histograms_figure(found)),
        hidden=None if (drawn := hidden_maps(found, hidden)) is None else png_uri(drawn), moved=hidden.height is not None,
        probes=probe_places(found).rows())
    path.write_text(page, encoding="utf-8")


def rows(figures: Figures, flat: bool) -> list[Row]:
    """The table of figures.

    Parameters
    ----------
    figures : Figures
        Of the mirror.
    flat : bool
        Whether the design is a plane, of which nothing has a percent.
    """
    of = figures.per_m if flat else figures.percent
    return [_row("height", "µm", figures.height, 1e3), _row("slope", "arcmin", figures.slope, 1.0),
            *(_row(key, "1/m" if flat else "%", of[key], 1.0) for key in QUANTITIES)]


def _row(name: str, unit: str, figure: Figure, scale: float) -> Row:
    if figure.largest is None or figure.interval is None or figure.rms is None or figure.sigma is None:
        return Row(name, unit, UNKNOWN_IN_WORDS, MISSING, MISSING, MISSING, MISSING)
    low, high = figure.interval
    return Row(name, unit, number(scale * figure.largest, sign=True), f"{number(scale * low, sign=True)} to "
               f"{number(scale * high, sign=True)}", point_in_words(figure.at_mm), number(scale * figure.rms),
               number(scale * figure.sigma))


def verdict_in_words(verdict: Verdict | None, found: Inspection) -> tuple[str, str, str]:
    """A class for the style, a heading and a sentence.

    Parameters
    ----------
    verdict : Verdict or None
        Against a limit.
    found : Inspection
        The mirror.
    """
    if verdict is None:
        return ("open", "No limit is asked for" if not found.fields.flat else "A limit in percent does not apply to a plane",
                "A limit for k1 and k2 stands in the specification: [limits] curvature_percent.")
    if verdict.surely_percent is None or verdict.possibly_percent is None:
        return "open", "Undecided", "Nowhere does the gauge stand on what was measured."
    limit = f"{plain(verdict.limit_percent)} %"
    text = (f"The deviation of k1 and k2 is at least {number(verdict.surely_percent)} % somewhere (95 % for all places "
            f"together) and at most {number(verdict.possibly_percent)} % (95 % of its place); the limit is {limit}. The gauge "
            f"stands on measured points at {number(100.0 * verdict.known_share)} % of the places where it fits on the mirror.")
    head = {"pass": f"Pass: within {limit}", "fail": f"Fail: beyond {limit}", "undecided": "Undecided at 95 %"}[verdict.outcome]
    return {"pass": "yes", "fail": "no", "undecided": "open"}[verdict.outcome], head, text


def basis(found: Inspection, source: str, against: str) -> list[tuple[str, str]]:
    """What the report stands on, in names and texts.

    Parameters
    ----------
    found : Inspection
        The mirror.
    source, against : str
        The measured file and the design.
    """
    left = "; ".join(f"{why}: {count(number_)}" for why, number_ in found.left_out.items()) or "none"
    reconstruction, alignment = found.reconstruction, found.alignment
    sigma = "no heights were measured" if not len(found.points) else (f"{number(1e3 * found.sigma_mm)} µm along the normal, "
                                                                      "" + (
        "as stated" + (f", times {number(reconstruction.sigma_factor)} because the residuals are larger"
                       if reconstruction.sigma_factor > 1.05 else "") if found.sigma_stated else
        "from the residuals"))
    placed = {"none": "as given", "321": "height and tilt by three places of the face, the rest as given",
              "best-fit": "best fit to the exact surface"}[found.align]
    if alignment is not None and alignment.undetermined:
        placed += (f"; {alignment.undetermined} of the six directions of motion are not told by the shape (a sphere may turn "
                   "about its centre) and stay as they began")
    if found.motion.reflected:
        placed += "; the points are those of the other hand's mirror and were reflected"
    spans = " × ".join(number(each) for each in reconstruction.fit.space.span_mm)
    return [("Measured", source), ("Against", against),
            ("Points", f"{count(int(found.used.sum()))} used, about {number(reconstruction.coverage.spacing_mm)} mm apart; "
                       f"left out: {left}"), ("Sigma of a point", sigma), ("Alignment", placed),
            ("Reconstruction", f"quintic B-spline of spans {spans} mm, by {reconstruction.principle}")]


def _jpeg(data: bytes) -> str:
    return f"data:image/jpeg;base64,{base64.b64encode(data).decode()}"


def svg_uri(data: bytes) -> str:
    """A drawing as an address that a page embeds.

    Parameters
    ----------
    data : bytes
        Of the SVG.
    """
    return f"data:image/svg+xml;base64,{base64.b64encode(data).decode()}"


def png_uri(data: bytes) -> str:
    """A picture as an address that a page embeds.

    Parameters
    ----------
    data : bytes
        Of the PNG.
    """
    return f"data:image/png;base64,{base64.b64encode(data).decode()}"
