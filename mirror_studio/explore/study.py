"""A study's TOML file in, a Study out: which keys are varied how, which measures are taken, what is asked for."""

from __future__ import annotations

import difflib
import hashlib
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator
from pydantic.functional_validators import PlainValidator

from mirror_cad.errors import SpecError
from mirror_cad.keys import Number, Section, is_number
from mirror_cad.spec.file import load_spec, read_toml, spec_as_json, validate_spec, validated
from mirror_studio.scene_file import load_scene

Array = NDArray[np.float64]
Value = float | str | bool

MAX_DESIGNS = 1_000_000


def _values(value: object) -> tuple[Value, ...] | None:
    if value is None:
        return None
    if not isinstance(value, list | tuple) or not value:
        raise ValueError("must be a list with a value or more")
    for one in value:
        if not isinstance(one, str | bool) and not (is_number(one) and not math.isnan(one)):
            raise ValueError(f"must be numbers or texts, and {one!r} is none")
    return tuple(one if isinstance(one, str | bool | int) else float(one) for one in value)


def measure_names(value: object) -> tuple[str, ...]:
    """A list of different names."""
    if not isinstance(value, list | tuple) or not all(isinstance(name, str) for name in value):
        raise ValueError("must be a list of measures' names")
    if len(set(value)) < len(value):
        raise ValueError("names a measure twice")
    return tuple(value)


def limit_ends(value: object) -> tuple[float, float]:
    """The least and the most of a measure."""
    if not isinstance(value, list | tuple) or len(value) != 2 or not all(
            is_number(end) and not math.isnan(end) for end in value):
        raise ValueError("must be two numbers, [least, most], with -inf or inf for a side that is free")
    if value[0] > value[1]:
        raise ValueError("the first number, the least, must not be above the second, the most")
    return float(value[0]), float(value[1])


class Range(Section):
    """How one key is varied: `values`, or from … to, `count` of them in a grid or as samples draw them."""

    values: Annotated[tuple[Value, ...] | None, PlainValidator(_values)] = None
    from_: Annotated[Number | None, Field(alias="from")] = None
    to: Number | None = None
    count: Annotated[int | None, Field(ge=1, le=100_000)] = None

    @model_validator(mode="after")
    def _one_way(self) -> Range:
        ends = self.from_ is not None and self.to is not None
        if (self.values is None) == (not ends):
            raise ValueError("needs either values = […], or from and to")
        if self.values is not None and self.count is not None:
            raise ValueError("count belongs to from and to")
        if ends and not self.from_ < self.to:  # type: ignore[operator]  # both are numbers
            raise ValueError(f"is empty: from = {self.from_:g} is not below to = {self.to:g}")
        return self

    def grid(self) -> tuple[Value, ...]:
        """All values, or `count` equally spaced ones from end to end."""
        if self.values is not None:
            return self.values
        return tuple(float(v) for v in np.linspace(self.from_ or 0.0, self.to or 0.0, self.count or 2))

    def at(self, share: float) -> Value:
        """The value at a share from 0 to 1."""
        if self.values is not None:
            return self.values[min(int(share * len(self.values)), len(self.values) - 1)]
        low, high = self.from_ or 0.0, self.to or 0.0
        return low + share * (high - low)


class OptimiseSection(Section):
    """What is to be small, what large, and between which ends measures must stay; how long is looked for it."""

    minimise: Annotated[tuple[str, ...], PlainValidator(measure_names)] = ()
    maximise: Annotated[tuple[str, ...], PlainValidator(measure_names)] = ()
    limits: dict[str, Annotated[tuple[float, float], PlainValidator(limit_ends)]] = Field(default_factory=dict)
    population: Annotated[int, Field(ge=4, le=10_000)] = 40
    generations: Annotated[int, Field(ge=1, le=10_000)] = 25


class StudyFile(Section):
    """A study as its TOML file states it."""

    spec: str
    scene: str | None = None
    measures: Annotated[tuple[str, ...], PlainValidator(measure_names)] = ()
    samples: Annotated[int | None, Field(ge=1, le=MAX_DESIGNS)] = None
    sampler: Literal["sobol", "halton", "latin"] = "sobol"
    seed: Annotated[int, Field(ge=0, le=2**31)] = 0
    vary: dict[str, Range]
    optimise: OptimiseSection | None = None


class Variants(Protocol):
    """What rows are of: mirrors that differ in the values of some keys, and the measures that are taken of each.

    folder : what file names of the specification are relative to.   scene : its name or path.
    """

    @property
    def keys(self) -> tuple[str, ...]:
        """What their values are called."""
        ...

    @property
    def measures(self) -> tuple[str, ...]:
        """By their names."""
        ...

    @property
    def folder(self) -> Path: ...  # noqa: D102  # as above

    @property
    def scene(self) -> str | None: ...  # noqa: D102

    def digest(self) -> str:
        """What tells these rows from others."""
        ...

    def with_values(self, values: Sequence[Value]) -> dict[str, Any]:
        """What a worker makes the mirror of."""
        ...


@dataclass(frozen=True, eq=False)
class Study:
    """A study whose keys, measures and files are known to exist.

    raw : the specification as JSON has it.   folder : what file names in it are relative to.   scene : its name or path.
    """

    file: StudyFile
    raw: dict[str, Any]
    folder: Path
    scene: str | None
    measures: tuple[str, ...]

    @property
    def keys(self) -> tuple[str, ...]:
        """What is varied, as a specification names it."""
        return tuple(self.file.vary)

    def designs(self) -> list[tuple[Value, ...]]:
        """The values of the keys, a row a design: the same for the same file."""
        ranges = list(self.file.vary.values())
        if self.file.samples is None:
            return list(product(*(each.grid() for each in ranges)))
        from scipy.stats import qmc

        kinds = {"sobol": qmc.Sobol, "halton": qmc.Halton, "latin": qmc.LatinHypercube}
        sampler = kinds[self.file.sampler](len(ranges), seed=self.file.seed)
        if self.file.sampler == "sobol":  # a power of two keeps its balance; what is asked for is its beginning
            shares = sampler.random_base2(max(self.file.samples - 1, 1).bit_length())[: self.file.samples]
        else:
            shares = sampler.random(self.file.samples)
        return [tuple(each.at(float(share)) for each, share in zip(ranges, row, strict=True)) for row in shares]

    def digest(self) -> str:
        """What tells this study from others: SHA-256 of all that its rows depend on."""
        file = self.file.model_dump(exclude={"spec", "scene"}, warnings=False)
        content = {"spec": self.raw, "scene": self.scene, "file": file, "measures": self.measures}
        return hashlib.sha256(json.dumps(content, sort_keys=True, default=str).encode()).hexdigest()

    def with_values(self, values: Sequence[Value]) -> dict[str, Any]:
        """The specification with the keys at these values, as JSON has it."""
        raw = deepcopy(self.raw)
        for key, value in zip(self.keys, values, strict=True):
            put(raw, key, value)
        return raw


def put(raw: dict[str, Any], key: str, value: Value) -> None:
    """Set `section.key`, or `section.key.0` for an entry of a list."""
    *path, last = key.split(".")
    at: Any = raw
    for name in path:
        at = at[int(name)] if isinstance(at, list) else at.setdefault(name, {})
        if not isinstance(at, dict | list):
            raise SpecError(f"vary.\"{key}\": {name} is no section and no list")
    if isinstance(at, list):
        if not last.isdecimal() or int(last) >= len(at):
            raise SpecError(f"vary.\"{key}\": the list has entries 0 to {len(at) - 1}, and no {last}")
        at[int(last)] = value
    else:
        at[last] = value


def load_study(path: Path, optimise: bool = False) -> Study:
    """Read a study.

    Parameters
    ----------
    path : Path
    optimise : bool
        Whether it is to have an [optimise] section.

    Raises
    ------
    SpecError
        For an unknown key, measure, specification or scene, with the nearest name, and for empty ranges.
    """
    from importlib import resources

    raw, source, folder = read_toml(path, resources.files("mirror_studio") / "studies", "study")
    file = validated(StudyFile, raw, source, folder)
    spec = load_spec(beside(file.spec, folder))
    study = Study(file, spec_as_json(spec), folder, None if file.scene is None else str(beside(file.scene, folder)), ())
    faults = [] if file.vary else [f"{source}: vary: no key is varied"]
    for key, each in file.vary.items():
        faults += [f"{source}: vary.{fault}" for fault in _faults_of_key(study, key, each.grid()[0])]
        if optimise and (each.values is not None):
            faults.append(f"{source}: vary.\"{key}\": optimise needs from and to, not values")
    if file.samples is None and not optimise:
        count = math.prod(len(each.grid()) for each in file.vary.values())
        if count > MAX_DESIGNS:
            faults.append(f"{source}: vary: the grid has {count} designs, at most {MAX_DESIGNS} are made: "
                          "samples = N draws some")
        faults += [f"{source}: vary.\"{key}\": a grid needs count" for key, each in file.vary.items()
                   if each.values is None and each.count is None]
    wanted = list(file.measures)
    if optimise:
        asked = file.optimise
        if asked is None or not (asked.minimise or asked.maximise):
            faults.append(f"{source}: optimise: minimise or maximise must name a measure")
        else:
            both = set(asked.minimise) & set(asked.maximise)
            faults += [f"{source}: optimise: {name} cannot be minimised and maximised" for name in sorted(both)]
            wanted += [name for name in (*asked.minimise, *asked.maximise, *asked.limits) if name not in wanted]
    elif not wanted:
        faults.append(f"{source}: measures: name one or more (`mirror-cad measures` lists them)")
    faults += [f"{source}: {fault}" for fault in faults_of_measures(wanted, study.raw, study.keys, study.scene)]
    if faults:
        raise SpecError(faults)
    return Study(study.file, study.raw, study.folder, study.scene, tuple(wanted))


def beside(name: str, folder: Path) -> str:
    """A file's name, relative to the folder of the study; a preset's own."""
    return str(folder / name) if name.endswith(".toml") else name


def _faults_of_key(study: Study, key: str, value: Value) -> list[str]:
    """Whether a specification has the key: what else is wrong with a value is its design's own failure."""
    raw = deepcopy(study.raw)
    try:
        put(raw, key, value)
        validate_spec(raw, "", study.folder)
    except SpecError as error:
        return [fault.removeprefix(": ") for fault in error.faults if "unknown key" in fault or "belongs to" in fault
                or "must be a section" in fault or fault.startswith("vary.")]
    return []


def faults_of_measures(names: Sequence[str], raw: Mapping[str, Any], keys: Iterable[str], scene: str | None) -> list[str]:
    """What is wrong with the measures that are asked for.

    Parameters
    ----------
    names : sequence of str
    raw : mapping
        The specification.
    keys : iterable of str
        What of it varies.
    scene : str or None
        Where the mirror is put.
    """
    from mirror_studio.rules.figures import needs_vehicle, rule_figures_known
    from raytrace.measures.registry import registered

    of_rules = rule_figures_known()
    faults = []
    for name in [name for name in names if name in of_rules]:
        if "rules" not in raw and not any(key.startswith("rules.") for key in keys):
            faults.append(f"{name} is a line of a rule: give the specification [rules] with rule and class")
        elif scene is None and needs_vehicle(name):
            faults.append(f"{name} is asked of a mirror on its vehicle: give scene = \"motorway\", say")
    names = [name for name in names if name not in of_rules]
    known = dict(registered())
    if scene is not None and any(name not in known for name in names):
        from mirror_studio.explore.evaluate import names_on_vehicle

        known |= dict.fromkeys(names_on_vehicle(scene))  # type: ignore[arg-type]  # names alone count
    elif scene is not None:
        load_scene(scene)
    for name in names:
        if name not in known:
            near = difflib.get_close_matches(name, [*known, *of_rules], n=1, cutoff=0.4)
            faults.append(f"unknown measure {name!r}" + (f"; did you mean {near[0]!r}?" if near else "")
                          + " (`mirror-cad measures` lists them)")
        elif scene is None and known[name].scope == "vehicle":
            faults.append(f"{name} is a measure of a mirror on its vehicle: give scene = \"motorway\", say")
    return faults
