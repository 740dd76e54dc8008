"""A tolerance study's TOML file in, the mirrors out that may come of it: each a departure from the design."""

from __future__ import annotations

import difflib
import hashlib
import json
from collections.abc import Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator
from pydantic.functional_validators import PlainValidator

from mirror_cad.design_stages import design
from mirror_cad.errors import SpecError
from mirror_cad.keys import Number, Section
from mirror_cad.laws.matched import with_solved
from mirror_cad.made.form_error import BAND, shortest_wavelength
from mirror_cad.spec.file import load_spec, read_toml, spec_as_json, validated
from mirror_studio.explore.study import Value, beside, faults_of_measures, limit_ends, measure_names, put
from mirror_studio.tolerances.factors import Factor, RandomQuantity, angle, departure, draw
from mirror_studio.tolerances.made import Departures, FormOfRow

Array = NDArray[np.float64]

MIN_SAMPLES, MAX_SAMPLES = 8, 65_536
EDGE = 2.0**-40  # of the sampled shares: a normal distribution has no end


class Spread(Section):
    """How far a quantity may be from the design: `sigma` of a normal distribution, or anywhere `within` so much of it."""

    sigma: Annotated[Number | None, Field(gt=0, le=1e6)] = None
    within: Annotated[Number | None, Field(gt=0, le=1e6)] = None

    @model_validator(mode="after")
    def _one(self) -> Spread:
        if (self.sigma is None) == (self.within is None):
            raise ValueError("give one of sigma (normally distributed) and within (anywhere up to so far to either side)")
        return self


class KeySpread(Spread):
    """That of a key of the specification; keys in `also` depart by as much with it."""

    also: Annotated[tuple[str, ...], PlainValidator(measure_names)] = ()


class FormSection(Section):
    """An error of form of the reflecting surface: a wave of any phase, in one direction or any, or a random map."""

    map: Literal["wave", "random"] = "wave"
    wavelength_mm: Annotated[Number, Field(gt=0, le=1e5)]
    amplitude_mm: Annotated[Number | None, Field(gt=0, le=10)] = None
    rms_mm: Annotated[Number | None, Field(gt=0, le=10)] = None
    direction_deg: Annotated[Number | None, Field(ge=-360, le=360)] = None

    @model_validator(mode="after")
    def _of_its_kind(self) -> FormSection:
        if self.map == "wave" and (self.amplitude_mm is None or self.rms_mm is not None):
            raise ValueError("map = \"wave\" has amplitude_mm, half of what is between crest and trough, and no rms_mm")
        if self.map == "random" and (self.rms_mm is None or self.amplitude_mm is not None):
            raise ValueError("map = \"random\" has rms_mm, and no amplitude_mm")
        if self.map == "random" and self.direction_deg is not None:
            raise ValueError("direction_deg belongs to map = \"wave\": a random map has none")
        return self

    @property
    def shortest_mm(self) -> float:
        """Of its wavelengths."""
        return self.wavelength_mm * (1.0 if self.map == "wave" else 1.0 - BAND)


class WedgeSection(Section):
    """How much thicker the glass becomes to the right and upwards, as an angle between its faces."""

    across_arcmin: Spread | None = None
    upright_arcmin: Spread | None = None


class AimSection(Section):
    """How far the mirror is turned from its aim."""

    yaw_deg: Spread | None = None
    pitch_deg: Spread | None = None


class EyeSection(Section):
    """How far the eye is from its place, as the driver looks at the mirror or along the vehicle."""

    right_mm: Spread | None = None
    up_mm: Spread | None = None
    rearward_mm: Spread | None = None


def _power_of_two(value: object) -> int:
    if isinstance(value, int) and not isinstance(value, bool) and MIN_SAMPLES <= value <= MAX_SAMPLES:
        if value & (value - 1) == 0:
            return value
        raise ValueError(f"must be a power of two: {1 << (value.bit_length() - 1)} or {1 << value.bit_length()}")
    raise ValueError(f"must be a power of two from {MIN_SAMPLES} to {MAX_SAMPLES}")


class TolerancesFile(Section):
    """A tolerance study as its TOML file states it."""

    spec: str
    scene: str | None = None
    measures: Annotated[tuple[str, ...], PlainValidator(measure_names)] = ()
    samples: Annotated[int, PlainValidator(_power_of_two)] = 128
    seed: Annotated[int, Field(ge=0, le=2**31)] = 0
    interval_percent: Annotated[Number, Field(ge=50, lt=100)] = 95.0
    limits: dict[str, Annotated[tuple[float, float], PlainValidator(limit_ends)]] = Field(default_factory=dict)
    keys: dict[str, KeySpread] = Field(default_factory=dict)
    form: dict[str, FormSection] = Field(default_factory=dict)
    wedge: WedgeSection = WedgeSection()
    aim: AimSection = AimSection()
    eye: EyeSection = EyeSection()


@dataclass(frozen=True, eq=False)
class Tolerances:
    """A tolerance study whose keys, measures and files are known to exist.

    raw : the design as JSON has it, with what `match` was solved for.   folder : what file names in it are relative to.
    scene : its name or path.   limits : the least and the most that is asked of measures.
    """

    file: TolerancesFile
    raw: dict[str, Any]
    folder: Path
    scene: str | None
    measures: tuple[str, ...]
    limits: dict[str, tuple[float, float]]

    @cached_property
    def factors(self) -> tuple[Factor, ...]:
        """The tolerances, each with the columns of a row that it fills."""
        return tuple(_factors(self.file))

    @cached_property
    def columns(self) -> tuple[RandomQuantity, ...]:
        """Of all factors, one after the other."""
        return tuple(column for factor in self.factors for column in factor.columns)

    @property
    def keys(self) -> tuple[str, ...]:
        """What the columns are called."""
        return tuple(column.name for column in self.columns)

    def mirrors(self) -> list[tuple[float, ...]]:
        """The mirrors' departures, samples × (tolerances + 2) of them: A, B, and A with one tolerance's columns of B.

        References
        ----------
        A. Saltelli et al., "Variance based sensitivity analysis of model output", Comput. Phys. Commun. 181, 259 (2010).
        """
        from scipy.stats import qmc

        width, count = len(self.columns), self.file.samples
        shares = np.clip(qmc.Sobol(2 * width, rng=self.file.seed).random(count), EDGE, 1.0 - EDGE)
        a, b = shares[:, :width], shares[:, width:]
        blocks, start = [a, b], 0
        for factor in self.factors:
            mixed, end = a.copy(), start + len(factor.columns)
            mixed[:, start:end] = b[:, start:end]
            blocks.append(mixed)
            start = end
        return [tuple(column.at(float(share)) for column, share in zip(self.columns, row, strict=True))
                for block in blocks for row in block]

    def digest(self) -> str:
        """What tells this study from others: SHA-256 of all that its rows depend on."""
        file = self.file.model_dump(exclude={"spec", "scene", "limits", "interval_percent"}, warnings=False)
        content = {"tolerances": 1, "spec": self.raw, "scene": self.scene, "file": file, "measures": self.measures}
        return hashlib.sha256(json.dumps(content, sort_keys=True, default=str).encode()).hexdigest()

    def with_values(self, values: Sequence[Value]) -> dict[str, Any]:
        """The specification of a mirror with its departures, and what no specification has of them."""
        of = {key: float(value) for key, value in zip(self.keys, values, strict=True)}
        raw, design_ = deepcopy(self.raw), numbers(self.raw)
        for key, spread in self.file.keys.items():
            for each in (key, *spread.also):
                put(raw, each, design_[each] + of[key])
        forms = tuple(_form_of_row(name, each, of) for name, each in self.file.form.items())
        return {"spec": raw, "made": Departures(
            forms, (of.get("wedge.across_arcmin", 0.0), of.get("wedge.upright_arcmin", 0.0)),
            (of.get("aim.yaw_deg", 0.0), of.get("aim.pitch_deg", 0.0)),
            (of.get("eye.right_mm", 0.0), of.get("eye.up_mm", 0.0), of.get("eye.rearward_mm", 0.0)))}

    def as_designed(self) -> dict[str, Any]:
        """What the mirror without departures is made of."""
        return {"spec": self.raw, "made": Departures()}


def load_tolerances(path: Path) -> Tolerances:
    """Read a tolerance study.

    Parameters
    ----------
    path : Path

    Raises
    ------
    SpecError
        For an unknown key, measure, specification or scene, with the nearest name, for what is no tolerance, and for waves
        that are too short for a surface to hold.
    """
    raw, source, folder = read_toml(path, resources.files("mirror_studio") / "tolerances", "tolerance study")
    file = validated(TolerancesFile, raw, source, folder)
    spec = load_spec(beside(file.spec, folder))
    mirror = design(spec)
    solved = spec.model_copy(update={"horizontal": with_solved(spec.horizontal, mirror.matched)})
    scene = None if file.scene is None else str(beside(file.scene, folder))
    measures = tuple(dict.fromkeys((*file.measures, *file.limits)))
    limits = {name: ends for name, ends in spec.limits.by_name().items() if name in measures} | file.limits
    study = Tolerances(file, spec_as_json(solved), folder, scene, measures, limits)
    faults = [] if study.factors else ["no tolerance is given: [keys], [form], [wedge], [aim] or [eye]"]
    if not measures:
        faults.append("measures: name one or more (`mirror-cad measures` lists them)")
    faults += faults_of_measures(measures, study.raw, file.keys, scene)
    faults += _faults_of_keys(study)
    least = shortest_wavelength(mirror.surface)
    faults += [f"form.{name}.wavelength_mm = {each.wavelength_mm:g}: "
               + (f"its shortest waves, {each.shortest_mm:.3g} mm, are" if each.map == "random" else "is")
               + f" shorter than what the spans of a surface of this size hold, {least:.3g} mm"
               for name, each in file.form.items() if each.shortest_mm < least]
    if (file.wedge.across_arcmin or file.wedge.upright_arcmin) and spec.glass.reflecting != "back":
        faults.append("wedge: light does not go through the glass of a mirror that reflects from its front: "
                      "the specification needs glass.reflecting = \"back\"")
    if (file.aim.yaw_deg or file.aim.pitch_deg) and scene is None:
        faults.append("aim: a mirror is aimed on its vehicle: give scene = \"motorway\", say")
    if faults:
        raise SpecError([f"{source}: {fault}" for fault in faults])
    return study


def numbers(raw: dict[str, Any]) -> dict[str, float]:
    """The keys of a specification that hold a number that is no count, by section and key."""
    return dict(_numbers(raw, ""))


def _numbers(values: Any, prefix: str) -> Iterator[tuple[str, float]]:
    for key, value in values.items() if isinstance(values, dict) else enumerate(values):
        if isinstance(value, float):
            yield f"{prefix}{key}", value
        elif isinstance(value, dict | list | tuple):
            yield from _numbers(value, f"{prefix}{key}.")


def _faults_of_keys(study: Tolerances) -> list[str]:
    known, faults, taken = numbers(study.raw), [], set()
    for name, spread in study.file.keys.items():
        for key in (name, *spread.also):
            if key in taken:
                faults.append(f"keys.\"{key}\": has a tolerance already")
            elif key not in known:
                near = difflib.get_close_matches(key, known, n=1, cutoff=0.4)
                faults.append(f"keys.\"{key}\": the specification has no number of this name"
                              + (f"; did you mean {near[0]!r}?" if near else ""))
            taken.add(key)
    return faults


def _form_of_row(name: str, form: FormSection, of: dict[str, float]) -> FormOfRow:
    size = (form.amplitude_mm if form.rms_mm is None else form.rms_mm) or 0.0
    if form.map == "random":
        return FormOfRow(size, form.wavelength_mm, None, None, of[f"form.{name}.draw"])
    direction = form.direction_deg if form.direction_deg is not None else of[f"form.{name}.direction_deg"]
    return FormOfRow(size, form.wavelength_mm, direction, of[f"form.{name}.phase_deg"], None)


def _factors(file: TolerancesFile) -> Iterator[Factor]:
    for name, spread in file.keys.items():
        yield Factor(name, (departure(name, spread.sigma, spread.within),), " and ".join((name, *spread.also)))
    for name, form in file.form.items():
        size = f"{form.amplitude_mm:g} mm" if form.rms_mm is None else f"{form.rms_mm:g} mm RMS"
        words = f"{'random map' if form.map == 'random' else 'wave'} of {size} at {form.wavelength_mm:g} mm"
        columns: tuple[RandomQuantity, ...] = (draw(f"form.{name}.draw"),)
        if form.map == "wave":
            columns = (angle(f"form.{name}.phase_deg", 360.0),)
            if form.direction_deg is None:
                columns += (angle(f"form.{name}.direction_deg", 180.0),)
        yield Factor(f"form.{name}", columns, words)
    for section, spreads in (("wedge", file.wedge), ("aim", file.aim), ("eye", file.eye)):
        for key in type(spreads).model_fields:
            one: Spread | None = getattr(spreads, key)
            if one is not None:
                yield Factor(f"{section}.{key}", (departure(f"{section}.{key}", one.sigma, one.within),), f"{section}.{key}")
