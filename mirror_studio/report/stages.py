"""A CurvatureDeviation in; the table of its stages, what explains the total and what turns a reflected ray, in words, out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mirror_cad.deviation import CurvatureDeviation
from mirror_cad.laws.words import plain
from mirror_cad.surfaces.differential import rms_norm
from mirror_cad.surfaces.faithful import Faithful
from mirror_studio.report.fields import QUANTITIES
from mirror_studio.report.tables import Table
from mirror_studio.report.text import MISSING, NARROW_SPACE, count, given, number, place, with_unit

NUMERICAL = ("integration", "fit", "step")
STAGE_NAMES = {"integration": "integration", "fit": "fit", "step": "STEP"}
STAGES = {
    "model": "the exact {method} surface against the design",
    "integration": "its profile as integrated",
    "fit": "the B-spline",
    "step": "the B-spline as read back from STEP",
    "total": "read back, against the design",
}
FLOOR_DIGITS = 4  # a floor and the level before it differ in the third
LARGEST_SHARE = 1e6  # “1 in” more than this tells nobody more than the two figures


@dataclass(frozen=True, slots=True)
class Floor:
    """How the faithful surface's shape RMS fell with its spans.   levels : (spans, percent), percent None for a plane."""

    degree: int
    settled: bool
    levels: tuple[tuple[tuple[int, int], float | None], ...]

    @staticmethod
    def measured(entry: Mapping[str, Any] | None) -> Floor | None:
        """From `methods.floor` of metrics.json."""
        if not entry:
            return None
        levels = tuple(((int(level["spans"][0]), int(level["spans"][1])), level["shape_rms_percent"])
                       for level in entry["levels"])
        return Floor(entry["degree"], entry["settled"], levels)

    @staticmethod
    def found(faithful: Faithful | None) -> Floor | None:
        """Of a mirror that is built faithful."""
        if faithful is None:
            return None
        return Floor(faithful.degree, faithful.settled,
                     tuple((level.spans, level.shape_rms_percent) for level in faithful.levels))

    def in_words(self) -> str | None:
        """“refining the spans from 6 × 5 to 8 × 6 (degree 7) changed what is left from 1.405 % to 1.400 %, and more …”."""
        reached = [(spans, percent) for spans, percent in self.levels if percent is not None]
        if not reached:
            return None
        (first, began), (last, left) = reached[0], reached[-1]
        if len(reached) == 1:
            return (f"the one set of spans asked for ({spans_in_words(last)} with those around the mirror, degree "
                    f"{self.degree}) leaves {_percent(left)} and cannot tell how near the floor that is")
        text = (f"refining the spans from {spans_in_words(first)} to {spans_in_words(last)} (degree {self.degree}) changed "
                f"what is left from {_percent(began)} to {_percent(left)}")
        if self.settled:
            return f"{text}, and more of them would gain nothing that matters"
        return f"{text}, the last step still by {with_unit(reached[-2][1] - left, 'percentage points', 2)}"


def stage_rows(deviation: CurvatureDeviation, method: str) -> list[dict[str, Any]]:
    """The table: model, integration, fit, STEP and total, each with k1 … twist and shape, and with height and slope."""
    rows = []
    for name, what in STAGES.items():
        entry = deviation.total if name == "total" else deviation.stages[name]
        cells = []
        for key in (*QUANTITIES, "shape"):
            signed = key != "shape"
            nothing = entry[f"{key}_max_per_m"] == 0.0
            cells.append({
                "max": with_unit(entry[f"{key}_max_percent"], "%", sign=signed),
                "rms": with_unit(entry[f"{key}_rms_percent"], "%"),
                "per_m": with_unit(entry[f"{key}_max_per_m"], "/m", sign=signed),
                "place": MISSING if nothing else place(entry[f"{key}_max_at_mm"]),
            })
        rows.append({
            "name": STAGE_NAMES.get(name, name), "what": what.format(method=method), "cells": cells,
            "sag": with_unit(entry["sag_max_mm"], "mm", sign=True), "slope": with_unit(entry["slope_max_arcsec"], "″"),
            "sag_place": MISSING if entry["sag_max_mm"] == 0.0 else place(entry["sag_max_at_mm"]),
            "slope_place": MISSING if entry["slope_max_arcsec"] == 0.0 else place(entry["slope_max_at_mm"]),
        })
    return rows


def stages_table(deviation: CurvatureDeviation) -> Table:
    """A row for each quantity of each stage and of the total; heights in mm and slopes in arc seconds are rows too."""
    keys = ("stage", "quantity", "max_percent", "rms_percent", "max_per_m", "max_mm", "max_arcsec", "x_mm", "y_mm")
    columns: dict[str, list[Any]] = {key: [] for key in keys}
    for stage in STAGES:
        entry = deviation.total if stage == "total" else deviation.stages[stage]
        rows = [{"quantity": key, "max_percent": entry[f"{key}_max_percent"], "rms_percent": entry[f"{key}_rms_percent"],
                 "max_per_m": entry[f"{key}_max_per_m"], "at": entry[f"{key}_max_at_mm"]} for key in (*QUANTITIES, "shape")]
        rows += [{"quantity": "height", "max_mm": entry["sag_max_mm"], "at": entry["sag_max_at_mm"]},
                 {"quantity": "slope", "max_arcsec": entry["slope_max_arcsec"], "at": entry["slope_max_at_mm"]}]
        for row in rows:
            full = {"stage": stage, "x_mm": row["at"][0], "y_mm": row["at"][1]} | row
            for key, column in columns.items():
                column.append(full.get(key))
    return Table("stages", columns)


def explained_sentences(deviation: CurvatureDeviation) -> str:
    """How model and numerics make up the total, and what they leave unexplained."""
    explained = deviation.explained
    left = explained["unexplained_max_per_m"]
    sums = "exactly" if left == 0.0 else f"but for {with_unit(left, '/m', 2)}, which is rounding"
    last = f"At every place the stages add up to the total {sums}: nothing is left unexplained."
    if explained["total_shape_rms_percent"] is None:
        stages = deviation.stages
        numerical = max(stages[name]["shape_max_per_m"] for name in NUMERICAL)
        return (f"The design is flat, so its deviation has no percent. Of the shape operator the model misses "
                f"{with_unit(stages['model']['shape_rms_per_m'], '/m')} (RMS), each numerical stage at most "
                f"{with_unit(numerical, '/m', 2)}; the total is {with_unit(deviation.total['shape_rms_per_m'], '/m')}. {last}")
    designed = 1e3 * rms_norm(deviation.designed, deviation.grid.weights)
    model, numerical, total = (
        f"{with_unit(percent, '%')} ({with_unit(0.01 * percent * designed, '/m')})"
        for percent in (explained[f"{part}_shape_rms_percent"] for part in ("model", "numerical", "total")))
    return (f"Of the deviation of the shape operator, RMS over the mirror in percent of the designed "
            f"{with_unit(designed, '/m')}, the model has {model}, integration, fit and STEP together have {numerical}, and "
            f"the total is {total}. {last}")


def model_sentences(deviation: CurvatureDeviation, method: str, floor: Floor | None, held_percent: float) -> str:
    """How much of the deviation is the model's own and why no numerics remove it, and how small the rest is.

    held_percent : a model whose shape RMS is below this holds its laws as well as the numerics are asked to.
    """
    entry = deviation.stages["model"]
    model = largest_of_pair(entry)
    if model is None:
        return f"The {method} surface of a flat design is the plane itself, and the model adds nothing."
    held = entry["shape_rms_percent"] < held_percent
    start = (SPHERE_REASON if method == "sphere" else
             _faithful_reason(floor, held) if method == "faithful" else _decoupled_reason(held))
    per_m = max(abs(entry[f"{key}_max_per_m"]) for key in ("k1", "k2"))
    size = f"{start} Here it is up to {with_unit(model, '%')} of k1 or k2 ({with_unit(per_m, '/m')})"
    rest = max(largest_of_pair(deviation.stages[name]) or 0.0 for name in NUMERICAL)
    if rest == 0.0:
        return f"{size}, and the other stages add nothing."
    share = f", a share of 1 in {count(float(f'{model / rest:.1e}'))}" if 10.0 < model / rest < LARGEST_SHARE else ""
    return f"{size}; integration, fit and STEP add at most {with_unit(rest, '%', 2)} each{share}."


SPHERE_REASON = ("The model stage is rounding: the model is the sphere of the radius that both laws state, and holds them "
                 "everywhere.")


def _decoupled_reason(held: bool) -> str:
    if held:
        return ("The model stage is what the decoupled construction itself misses, whatever the numerics: circles of radius "
                "Ry(x) hung on the horizontal profile. These laws it holds.")
    return ("The model stage is the part that no numerics can remove. The decoupled construction hangs circles of radius Ry(x) "
            "on the horizontal profile, and such a surface cannot have the designed curvatures everywhere: to first order it "
            "has the twist −y·(Ry′ − z′)/Ry², where the profile has the slope z′ = −tan θ, and its vertical curvature is "
            "cos θ/Ry. Where kx and ky are close, the twist moves k1 and k2 apart by its own size, one up and one down.")


def _faithful_reason(floor: Floor | None, held: bool) -> str:
    words = floor.in_words() if floor is not None else None
    start = ("The model stage is the part that no numerics can remove. The faithful surface is the one whose shape operator "
             "comes closest to diag(1/Rx, 1/Ry) over the whole mirror, in least squares")
    if held:
        return f"{start}. These laws it holds{f': {words}' if words else ''}."
    return (f"{start}; what it leaves is, once the spans suffice, the floor of the laws themselves. By the equations of Gauss "
            "and Codazzi both can hold everywhere only on a surface of revolution about an axis along x, where Rx settles Ry "
            "but for one number, or on a cylinder: a free choice of both radii cannot hold exactly."
            f"{f' {words[0].upper()}{words[1:]}.' if words else ''}")


def chain_links(deviation: CurvatureDeviation) -> list[dict[str, str]]:
    """What each link may turn a reflected ray by, from the exact surface to the eye: its name, amount and a note."""
    chain = deviation.chain
    links = [{"name": "kernel", "value": _arcmin(chain["kernel"]), "note": "integration and fit"},
             {"name": "file", "value": _arcmin(chain["file"]), "note": "STEP read back"}]
    if chain["mesh"] is not None:
        links.append({"name": "mesh", "value": _arcmin(chain["mesh"]), "note": "only if the STL is used"})
    percent = given(chain["glass_percent"], "%")
    if deviation.percent is None:
        note = "a limit in percent says nothing of flat glass"
    elif deviation.part is None:
        note = f"for each {percent} of curvature, as no limit is stated"
    else:
        note = f"at the stated limit of {percent}"
    links.append({"name": "glass", "value": f"±{_arcmin(chain['glass'])}" if chain["glass"] else MISSING, "note": note})
    return [*links, {"name": "eye resolves", "value": f"{plain(chain['eye'])}′", "note": "less is not seen"}]


def weakest_sentence(chain: Mapping[str, Any]) -> str:
    """Which link turns the ray most, and which of them the eye could see."""
    eye = chain["eye"]
    links = ["kernel", "file", *(["glass"] if chain["glass"] else [])]  # a share of no curvature turns nothing
    name = max(links, key=lambda link: chain[link])
    weakest = chain[name]
    also_above = [link for link in links if chain[link] > eye and link != name]
    below = [link for link in links if chain[link] <= eye]
    if weakest == 0.0:
        text = "Neither kernel nor file turns the ray at all."
    elif weakest <= eye:
        text = (f"The weakest link is the {name}, at {number(weakest / eye, 2)} of what the eye resolves: "
                f"{_listed(links)} all stay below it.")
    else:
        text = f"The weakest link is the {name}, {number(weakest / eye, 2)} times what the eye resolves"
        text += f"; above it {'are' if len(also_above) > 1 else 'is'} also the {_listed(also_above)}" if also_above else ""
        text += f"; the {_listed(below)} {'stay' if len(below) > 1 else 'stays'} below it." if below else "."
    mesh = chain["mesh"]
    if mesh is None or mesh == 0.0:
        return text
    more = ", more than any other link" if mesh > weakest else ""
    return f"{text} Where the STL is used, its facets come to {number(mesh / eye, 2)} times what the eye resolves{more}."


def largest_of_pair(entry: Mapping[str, Any]) -> float | None:
    """The larger deviation of k1 and k2 of a stage, percent, without its sign; None for a plane."""
    found = [abs(entry[f"{key}_max_percent"]) for key in ("k1", "k2") if entry[f"{key}_max_percent"] is not None]
    return max(found) if found else None


def spans_in_words(spans: Sequence[int]) -> str:
    """“8 × 6”, along x and y."""
    return f"{spans[0]}{NARROW_SPACE}×{NARROW_SPACE}{spans[1]}"


def _percent(value: float) -> str:
    return with_unit(value, "%", FLOOR_DIGITS)


def _arcmin(value: float) -> str:
    return with_unit(value, "′")


def _listed(names: Sequence[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
