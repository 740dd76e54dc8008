"""One design of a study in, its measures out: a row, also where it fails."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from mirror_cad.design_stages import design
from mirror_cad.errors import MirrorError
from mirror_cad.spec import MirrorSpec
from mirror_cad.spec.file import load_spec, validate_spec
from mirror_studio.drive.measured import asked_of, in_use, shown_round
from mirror_studio.drive.mirrors import exported, on_vehicle
from mirror_studio.drive.world import bodies_and_left_out
from mirror_studio.rules.figures import rule_figures
from mirror_studio.scene_file import SceneFile, load_scene
from mirror_studio.viewing_setup import ViewingSetup
from raytrace.measures.asked import Asked
from raytrace.measures.in_use import MirrorInUse
from raytrace.measures.registry import measures_of
from raytrace.reflector import Reflector


@dataclass(frozen=True, slots=True)
class Row:
    """What became of one design.   figures : by measure, None for what the mirror does not show; all None where it failed."""

    index: int
    values: tuple[float | str | bool, ...]
    figures: tuple[float | None, ...]
    status: str
    cause: str


def evaluate(index: int, values: tuple[float | str | bool, ...], raw: dict[str, Any], folder: str, scene: str | None,
             measures: Sequence[str], from_file: bool = False) -> Row:
    """Design one mirror and take its measures. Whatever goes wrong is the row's cause.

    from_file : of what its exported STEP file holds.
    """
    return row_of(index, values, measures, lambda: _in_use(raw, folder, scene, from_file))


def row_of(index: int, values: tuple[float | str | bool, ...], measures: Sequence[str],
           make: Callable[[], tuple[MirrorSpec, MirrorInUse]]) -> Row:
    """Take the measures of the mirror that `make` makes. Whatever goes wrong there or here is the row's cause."""
    try:
        spec, use = make()
        known = measures_of(use)
        rules = [name for name in measures if name not in known]
        of_rule = rule_figures(spec, use.setup.reflector, use.vehicle, rules) if rules else {}
        twice = use.vehicle is not None and shown_round(use.vehicle.views).twice
        figures = tuple(of_rule.get(name) if name not in known else None if twice and not known[name].local else
                        _number(known[name].value(use)) for name in measures)
    except MirrorError as error:
        return failed(index, values, len(measures), " ".join(str(error).split()))
    except Exception as error:  # a design that no message was written for is a row as well
        return failed(index, values, len(measures), f"internal error: {type(error).__name__}: {error}")
    return Row(index, values, figures, "ok", "")


def evaluate_file(index: int, values: tuple[float | str | bool, ...], raw: dict[str, Any], folder: str, scene: str | None,
                  measures: Sequence[str]) -> Row:
    """`evaluate` of the mirror as its exported STEP file has it."""
    return evaluate(index, values, raw, folder, scene, measures, True)


def failed(index: int, values: tuple[float | str | bool, ...], count: int, cause: str) -> Row:
    """The row of a design that has no figures."""
    return Row(index, values, (None,) * count, "failed", cause)


def names_on_vehicle(scene: str) -> tuple[str, ...]:
    """The measures that a scene has, those at its own distances among them."""
    from mirror_cad.spec.file import spec_as_json

    return tuple(measures_of(_in_use(spec_as_json(load_spec("sphere-950")), ".", scene)[1]))


def _in_use(raw: dict[str, Any], folder: str, scene: str | None, from_file: bool = False) -> tuple[MirrorSpec, MirrorInUse]:
    spec = validate_spec(raw, "design", Path(folder))
    mirror = design(spec)
    reflector = exported(spec) if from_file else Reflector.from_mirror(mirror)
    if scene is None:
        return spec, ViewingSetup.of(spec, mirror.box).in_use(reflector, mirror)
    loaded, asked = scene_and_asked(scene)
    return spec, in_use(on_vehicle(spec.name, reflector, loaded, spec, mirror), asked)


@lru_cache(maxsize=4)
def scene_and_asked(name: str) -> tuple[SceneFile, Asked]:
    """A scene, and what it has measured."""
    loaded = load_scene(name)
    named, _ = bodies_and_left_out(loaded)
    return loaded, asked_of(loaded, {name: body for name, body in named if name})


def _number(value: float | None) -> float | None:
    return None if value is None else float(value)
