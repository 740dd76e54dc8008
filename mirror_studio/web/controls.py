"""The page's controls, made from the specification's schema: label, unit, range and what each is shown with."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from mirror_cad.keys import Shown
from mirror_cad.laws import Law, Matched, registered
from mirror_cad.spec import MirrorSpec
from mirror_studio.web.protocol import ViewSettings

Kind = Literal["number", "choice", "text", "flag"]


@dataclass(frozen=True, slots=True)
class Control:
    """An input of the page for one key of a specification.

    low, high : ends of the slider; a number may be entered beyond them, as far as the specification takes it.
    least, most : what a number of a look may be; None where the specification judges.
    step : what an arrow key changes it by.   digits : shown after the point.   choices : values with their words.
    law : the laws that have this key.   optional : may be left out, with `default` to begin with when it is put in.
    part : which entry of a list.
    """

    key: str
    label: str
    kind: Kind = "number"
    unit: str = ""
    low: float | None = None
    high: float | None = None
    step: float = 1.0
    digits: int = 3
    choices: tuple[tuple[Any, str], ...] = ()
    law: tuple[str, ...] = ()
    optional: bool = False
    default: Any = None
    help: str = ""
    least: float | None = None
    most: float | None = None


@dataclass(frozen=True, slots=True)
class Group:
    """Controls under one heading.

    view : the view that they are there for; "" for all.   section : of the specification, of which it has all.
    """

    title: str
    controls: tuple[Control, ...]
    open: bool = False
    view: Literal["", "road"] = ""
    section: str = ""


def _metres(key: str, label: str, low: float, high: float, help_: str) -> Control:
    return Control(key, label, unit="m", low=low, high=high, step=0.01, help=help_)


UNITS = {"_mm": "mm", "_deg": "°", "_percent": "%", "_px": "px"}  # by how a key ends
NUMBER = "number"  # among the words of a choice: a number may be entered instead


def groups() -> tuple[Group, ...]:
    """All controls of the page, those of the laws that are known now among them."""
    named = (
        Group("Aim and eyes on the road", (
            Control("look.hand", "Mirror", "choice", choices=(("left", "left-hand"), ("right", "right-hand")),
                    help="The laws describe the left mirror; the right one is its reflection"),
            Control("look.flank_share", "Host flank", low=0.0, high=0.5, step=0.01,
                    help="Share of the mirror's width, from its inboard edge, that the host vehicle's flank takes on the "
                         "horizon's row"),
            Control("look.horizon_share", "Horizon at", low=0.2, high=0.9, step=0.01,
                    help="Share of the mirror's height, from its lower edge, at which the horizon lies in the middle of the "
                         "width"),
            _metres("look.eye_x_m", "Eyes rearward", -0.3, 0.6, "Of where the scene has them; the mirror stays"),
            _metres("look.eye_y_m", "Eyes to the right", -0.8, 0.8, "Of the vehicle's middle"),
            _metres("look.eye_z_m", "Eyes above road", 1.0, 3.0, "The middle between the two ocular points"),
            Control("look.eyes_apart_m", "Eyes apart", unit="m", low=0.0, high=0.1, step=0.001, digits=4,
                    help="UN Regulation 46 has 0.065 m"),
        ), True, "road"),
        Group("Horizontal radius Rx", _law("horizontal", "Rx"), True, section="horizontal"),
        Group("Vertical radius Ry", _law("vertical", "Ry"), True, section="vertical"),
        Group("Eye and pose", (
            *_section("eye"),
            Control("look.yaw_deg", "Yaw", unit="°", low=-20.0, high=20.0, step=0.1,
                    help="Turns the face towards the driver's side, before the picture; on the road the aim does"),
            Control("look.pitch_deg", "Pitch", unit="°", low=-20.0, high=20.0, step=0.1,
                    help="Turns the face up, before the picture; on the road the aim does"),
        )),
        Group("Outline and blank", (*_section("outline"), *_section("blank")), section="outline"),
        Group("Glass", _section("glass")),
        Group("Scene", _section("scene"), section="scene"),
        Group("Surface and limits", (*_section("surface"), *_section("limits"))),
        Group("Part", _section("part")),
        Group("Files", (*_keys(MirrorSpec, ""), *_section("view"), *_section("export"))),
    )
    held = {control.key.split(".")[0] for group in named for control in group.controls}
    others = (Group(name.capitalize(), _section(name)) for name in MirrorSpec.model_fields if name not in held)
    return (*named, *(group for group in others if group.controls))


def controls() -> list[dict[str, Any]]:
    """All groups as JSON holds them."""
    look = ViewSettings.model_json_schema()["properties"]
    return [asdict(replace(group, controls=tuple(_bounded(control, look) for control in group.controls)))
            for group in groups()]


def laws() -> dict[str, dict[str, Any]]:
    """What the page has to know of each law, as JSON holds it.

    open : the key that may be "match", or None.   start : what the law's keys have when it is chosen (see `Shown`).
    points : by which keys its curve is dragged, with where they are and what they are called.
    """
    found = {}
    for name, law in registered().items():
        keys = {key: field for key, field in law.model_fields.items() if key not in ({"law"} | Law.horizontal_only)}
        points = [{"key": key, "at": shown.drag, "label": shown.label} for key, field in keys.items()
                  if (shown := _shown(field)).drag]
        starts = {key: _start(field) for key, field in keys.items()}
        found[name] = {"open": law.open_key if issubclass(law, Matched) else None, "points": points,
                       "start": {key: start for key, start in starts.items() if start is not None}}
    return found


def _section(name: str) -> tuple[Control, ...]:
    model = MirrorSpec.model_fields[name].annotation
    return tuple(_keys(model, f"{name}.")) if isinstance(model, type) and issubclass(model, BaseModel) else ()


def _law(section: str, axis: str) -> tuple[Control, ...]:
    """Every law's keys; one that several laws have is one control."""
    names = tuple((name, law.title or name) for name, law in registered().items())
    found: dict[str, Control] = {}
    for name, law in registered().items():
        for control in _keys(law, f"{section}.", axis):
            before = found.get(control.key)
            found[control.key] = replace(before or control, law=(*(before.law if before else ()), name))
    everywhere = [replace(control, law=()) if len(control.law) == len(names) else control for control in found.values()]
    beside = [control for control in everywhere if control.key.split(".")[1] in Law.horizontal_only]
    of_law = [control for control in everywhere if control not in beside]
    # What is solved for stands next to the keys that it is solved by.
    beside.sort(key=lambda control: not control.law)
    return (Control(f"{section}.law", "Law", "choice", choices=names), *of_law, *(beside if section == "horizontal" else ()))


def _keys(model: type[BaseModel], before: str, axis: str = "", given: bool = False) -> Iterator[Control]:
    """The controls of a section's keys.   given : the section itself may be left out, so that its keys are all optional."""
    for name, field in ((field.alias or name, field) for name, field in model.model_fields.items()):
        shown, kinds = _shown(field), _kinds(field.annotation)
        sections = [kind for kind in kinds if isinstance(kind, type) and issubclass(kind, BaseModel)]
        if sections and before:
            yield from _keys(sections[0], f"{before}{name}.", axis, type(None) in kinds)
        if sections or shown.elsewhere or (name == "law" and issubclass(model, Law)):
            continue
        control = Control(before + name, (shown.label or name.replace("_", " ")).replace("{axis}", axis), help=shown.help,
                          unit=shown.unit or next((unit for end, unit in UNITS.items() if name.endswith(end)), ""),
                          step=shown.step, digits=shown.digits, optional=type(None) in kinds and not given)
        if control.optional:
            control = replace(control, default=_plain(shown.start))
        if float in kinds or int in kinds:
            low, high = _range(field)
            control = replace(control, low=low if shown.low is None else shown.low,
                              high=high if shown.high is None else shown.high)
        words = [word for kind in kinds if get_origin(kind) is Literal for word in get_args(kind)]
        pair = next((kind for kind in kinds if get_origin(kind) is tuple and Ellipsis not in get_args(kind)), None)
        if shown.words or (words and float not in kinds and int not in kinds):
            choices = shown.words or tuple((one, str(one)) for one in words)
            slider = NUMBER in dict(choices) and shown.low is not None
            yield replace(control, kind="choice", low=shown.low if slider else None, high=shown.high if slider else None,
                          choices=choices)
        elif pair is not None:
            labels = shown.label.split(", ") if ", " in shown.label else [f"{control.label} {i + 1}" for i in (0, 1)]
            for i, label in enumerate(labels):
                default = shown.start[i] if control.optional and isinstance(shown.start, tuple) else None
                yield replace(control, key=f"{control.key}.{i}", label=label, low=shown.low, high=shown.high, default=default)
        elif float in kinds or int in kinds:
            yield control
        elif bool in kinds:
            yield replace(control, kind="choice", choices=((True, "yes"), (False, "no")))
        elif str in kinds:
            yield replace(control, kind="text")


def _shown(field: FieldInfo) -> Shown:
    return next((mark for mark in field.metadata if isinstance(mark, Shown)), Shown())


def _kinds(annotation: Any) -> list[Any]:
    """The types of a union, without what they are annotated with."""
    if hasattr(annotation, "__metadata__"):
        return _kinds(annotation.__origin__)
    if get_origin(annotation) in (Union, UnionType):
        return [kind for one in get_args(annotation) for kind in _kinds(one)]
    return [annotation]


def _range(field: FieldInfo) -> tuple[float, float]:
    """What the field itself takes, or where nobody says a slider's first range."""
    marks = list(field.metadata)
    for one in (field.annotation, *get_args(field.annotation)):
        for mark in getattr(one, "__metadata__", ()):
            marks += [mark, *getattr(mark, "metadata", ())]
    found = {side: getattr(mark, side) for mark in marks for side in ("gt", "ge", "lt", "le")
             if getattr(mark, side, None) is not None}
    low = float(found.get("ge", found.get("gt", 0.0)))
    high = float(found.get("le", found.get("lt", low + 1.0)))
    # The end itself is refused: a hundredth of the way in.
    inset = 0.01 * (high - low)
    return (low + inset if "gt" in found else low), (high - inset if "lt" in found else high)


def _plain(start: Any) -> Any:
    """A start that needs no law before it."""
    return None if isinstance(start, str) and start.startswith("$") else start


def _start(field: FieldInfo) -> Any:
    """What a law's key begins with; a key that must be given and says nothing of it begins in the middle of its range."""
    start, kinds = _shown(field).start, _kinds(field.annotation)
    if start is not None or not field.is_required():
        return start
    if float in kinds or int in kinds:
        middle = 0.5 * sum(_range(field))
        return middle if float in kinds else round(middle)
    words = [word for kind in kinds if get_origin(kind) is Literal for word in get_args(kind)]
    return words[0] if words else ""


def _bounded(control: Control, look: dict[str, Any]) -> Control:
    """With the limits that a message's look has for the key; one step inside where the limit itself is refused."""
    section, _, name = control.key.partition(".")
    if section != "look" or control.kind != "number":
        return control
    limits = look[name]
    least = limits["minimum"] if "minimum" in limits else limits["exclusiveMinimum"] + control.step
    return replace(control, least=least, most=limits["maximum"])
