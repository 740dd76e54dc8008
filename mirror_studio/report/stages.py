"""A deviation in words: the table of its stages, what explains the total, and what turns a reflected ray."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mirror_cad.curvature_fields import QUANTITIES
from mirror_cad.deviation import Deviation, RayDeviation
from mirror_cad.laws.words import plain
from mirror_cad.stage_deviation import QuantityDeviation, ShapeDeviation, StageDeviation
from mirror_cad.surfaces.differential import rms_norm
from mirror_cad.surfaces.faithful import Faithful
from mirror_studio.report.tables import Table
from mirror_studio.report.text import MISSING, NARROW_SPACE, count, given, number, point_in_words, with_unit

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


@dataclass(frozen=True, slots=True)
class StageCell:
    """One quantity of one stage, in words."""

    max: str
    rms: str
    per_m: str
    place: str


@dataclass(frozen=True, slots=True)
class StageRow:
    """One row of the table: k1 … twist and shape in `cells`, then height and slope, in words."""

    name: str
    what: str
    cells: tuple[StageCell, ...]
    sag: str
    sag_place: str
    slope: str
    slope_place: str


def stage_rows(deviation: Deviation, method: str) -> list[StageRow]:
    """The table: model, integration, fit, STEP and total, each with k1 … twist and shape, and with height and slope."""
    rows = []
    for name, stage in stages_and_total(deviation):
        cells = [*(_cell(stage.of(quantity)) for quantity in QUANTITIES), _cell(stage.shape)]
        rows.append(StageRow(
            "STEP" if name == "step" else name, STAGES[name].format(method=method), tuple(cells),
            with_unit(stage.sag_max_mm, "mm", sign=True), _place(stage.sag_max_mm, stage.sag_max_at_mm),
            with_unit(stage.slope_max_arcsec, "″"), _place(stage.slope_max_arcsec, stage.slope_max_at_mm)))
    return rows


def _cell(one: QuantityDeviation | ShapeDeviation) -> StageCell:
    signed = isinstance(one, QuantityDeviation)
    return StageCell(with_unit(one.max_percent, "%", sign=signed), with_unit(one.rms_percent, "%"),
                     with_unit(one.max_per_m, "/m", sign=signed), _place(one.max_per_m, one.max_at_mm))


def _place(size: float, at: tuple[float, float]) -> str:
    return MISSING if size == 0.0 else point_in_words(at)


def stages_and_total(deviation: Deviation) -> list[tuple[str, StageDeviation]]:
    """The deviations from surface to surface by the names of deviation.json, and the total."""
    stages = deviation.stages
    numerical = [("integration", stages.integration), ("fit", stages.fit), ("step", stages.step)]
    return [("model", stages.model), *numerical, ("total", deviation.total)] if deviation.of_laws else numerical


def numerical_stages(deviation: Deviation) -> list[tuple[str, StageDeviation]]:
    """Integration, fit and STEP, as people read their names."""
    return list(zip(("integration", "fit", "STEP"), deviation.stages.numerical(), strict=True))


def stages_table(deviation: Deviation) -> Table:
    """A row for each quantity of each stage and of the total; heights in mm and slopes in arc seconds are rows too."""
    keys = ("stage", "quantity", "max_percent", "rms_percent", "max_per_m", "max_mm", "max_arcsec", "x_mm", "y_mm")
    rows: list[tuple[str | float | None, ...]] = []
    for name, stage in stages_and_total(deviation):
        curvatures: dict[str, QuantityDeviation | ShapeDeviation] = {quantity: stage.of(quantity) for quantity in QUANTITIES}
        rows += [(name, quantity, one.max_percent, one.rms_percent, one.max_per_m, None, None, *one.max_at_mm)
                 for quantity, one in (curvatures | {"shape": stage.shape}).items()]
        rows += [(name, "height", None, None, None, stage.sag_max_mm, None, *stage.sag_max_at_mm),
                 (name, "slope", None, None, None, None, stage.slope_max_arcsec, *stage.slope_max_at_mm)]
    return Table("stages", dict(zip(keys, zip(*rows, strict=True), strict=True)))


def explained_sentences(deviation: Deviation) -> str:
    """How model and numerics make up the total, and what they leave unexplained."""
    if not deviation.of_laws:
        return "No law asked for this mirror's curvature, so there is no model to deviate and no total."
    explained = deviation.explained
    left = explained.unexplained_max_per_m
    sums = "exactly" if left == 0.0 else f"but for {with_unit(left, '/m', 2)}, which is rounding"
    last = f"At every point the stages add up to the total {sums}: nothing is left unexplained."
    shares = explained.model_shape_rms_percent, explained.numerical_shape_rms_percent, explained.total_shape_rms_percent
    if explained.total_shape_rms_percent is None:
        stages = deviation.stages
        numerical = max(stage.shape.max_per_m for stage in stages.numerical())
        return (f"The design is flat, so its deviation has no percent. Of the shape operator the model misses "
                f"{with_unit(stages.model.shape.rms_per_m, '/m')} (RMS), each numerical stage at most "
                f"{with_unit(numerical, '/m', 2)}; the total is {with_unit(deviation.total.shape.rms_per_m, '/m')}. {last}")
    designed = 1e3 * rms_norm(deviation.designed, deviation.grid.weights)
    of_model, of_numerics, of_total = (
        f"{with_unit(percent, '%')} ({with_unit(0.01 * percent * designed, '/m')})"
        for percent in shares if percent is not None)
    return (f"Of the deviation of the shape operator, RMS over the mirror in percent of the designed "
            f"{with_unit(designed, '/m')}, the model has {of_model}, integration, fit and STEP together have {of_numerics}, "
            f"and the total is {of_total}. {last}")


def model_sentences(deviation: Deviation, method: str, floor: Floor | None, held_percent: float) -> str:
    """How much of the deviation is the model's own and why no numerics remove it, and how small the rest is.

    held_percent : a model whose shape RMS is below this holds its laws as well as the numerics are asked to.
    """
    if not deviation.of_laws:
        return ("What the mirror misses of the wanted view is said in arc minutes under the verdicts. A view settles the "
                "normal at every place, and normals belong to a surface only where their slopes have no curl. What is left is "
                "the part that no surface shows.")
    stage = deviation.stages.model
    model, shape = stage.largest_principal_percent, stage.shape.rms_percent
    if model is None or shape is None:
        return f"The {method} surface of a flat design is the plane itself, and the model adds nothing."
    held = shape < held_percent
    start = (SPHERE_REASON if method == "sphere" else
             _faithful_reason(floor, held) if method == "faithful" else _decoupled_reason(held))
    size = f"{start} Here it is up to {with_unit(model, '%')} of k1 or k2 ({with_unit(stage.largest_principal_per_m, '/m')})"
    rest = max(one.largest_principal_percent or 0.0 for one in deviation.stages.numerical())
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


@dataclass(frozen=True, slots=True)
class Link:
    """One link between the exact surface and the eye, in words."""

    name: str
    value: str
    note: str


def chain_links(deviation: Deviation) -> list[Link]:
    """What each link may turn a reflected ray by, from the exact surface to the eye."""
    chain = deviation.rays
    links = [Link("kernel", _arcmin(chain.kernel), "integration and fit"), Link("file", _arcmin(chain.file), "STEP read back")]
    if chain.mesh is not None:
        links.append(Link("mesh", _arcmin(chain.mesh), "only if the STL is used"))
    percent = given(chain.glass_percent, "%")
    if deviation.percent is None:
        note = "a limit in percent says nothing of flat glass"
    elif deviation.part is None:
        note = f"for each {percent} of curvature, as no limit is stated"
    else:
        note = f"at the stated limit of {percent}"
    links.append(Link("glass", f"±{_arcmin(chain.glass)}" if chain.glass else MISSING, note))
    return [*links, Link("eye resolves", f"{plain(chain.eye)}′", "less is not seen")]


def weakest_sentence(chain: RayDeviation) -> str:
    """Which link turns the ray most, and which of them the eye could see."""
    eye, turns = chain.eye, {"kernel": chain.kernel, "file": chain.file}
    if chain.glass:  # a share of no curvature turns nothing
        turns["glass"] = chain.glass
    name = max(turns, key=lambda link: turns[link])
    weakest = turns[name]
    also_above = [link for link, turn in turns.items() if turn > eye and link != name]
    below = [link for link, turn in turns.items() if turn <= eye]
    if weakest == 0.0:
        text = "Neither kernel nor file turns the ray at all."
    elif weakest <= eye:
        text = (f"The weakest link is the {name}, at {number(weakest / eye, 2)} of what the eye resolves: "
                f"{_listed(list(turns))} all stay below it.")
    else:
        text = f"The weakest link is the {name}, {number(weakest / eye, 2)} times what the eye resolves"
        text += f"; above it {'are' if len(also_above) > 1 else 'is'} also the {_listed(also_above)}" if also_above else ""
        text += f"; the {_listed(below)} {'stay' if len(below) > 1 else 'stays'} below it." if below else "."
    mesh = chain.mesh
    if mesh is None or mesh == 0.0:
        return text
    more = ", more than any other link" if mesh > weakest else ""
    return f"{text} Where the STL is used, its facets come to {number(mesh / eye, 2)} times what the eye resolves{more}."


def spans_in_words(spans: Sequence[int]) -> str:
    """“8 × 6”, along x and y."""
    return f"{spans[0]}{NARROW_SPACE}×{NARROW_SPACE}{spans[1]}"


def _percent(value: float) -> str:
    return with_unit(value, "%", FLOOR_DIGITS)


def _arcmin(value: float) -> str:
    return with_unit(value, "′")


def _listed(names: Sequence[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
