"""A mirror, a rule and perhaps a vehicle in, a sheet of the rule's lines out: page, JSON and CSV."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from mirror_cad.errors import SpecError
from mirror_cad.own_files import transition_of
from mirror_studio.build.folder import MANIFEST, new_set
from mirror_studio.build.pipeline import hashes, stated_placement, versions, write_json
from mirror_studio.drive.mirrors import on_vehicle, reflector_named
from mirror_studio.progress import Progress
from mirror_studio.rules.measuring import NOTHING_STATED, RuleQuantities, StatedProperties
from mirror_studio.rules.mounted import Mounted
from mirror_studio.rules.obstruction import FLAT_MM, Piece, VehicleBody
from mirror_studio.rules.of_spec import stated_by
from mirror_studio.rules.schema import RuleFile, load_rule
from mirror_studio.rules.settings import Load, adjusted, check_adjustment, under_load
from mirror_studio.rules.sheet import SheetTitle, write_sheet
from mirror_studio.rules.verdicts import RuleLine, judged
from mirror_studio.scene_file import SceneFile, load_scene
from raytrace.errors import TraceError
from raytrace.seating import Place

MIN_LEG_MM, LONGEST_LEG_MM = 1.0, 300.0


@dataclass(frozen=True, slots=True)
class RuleRequest:
    """What one sheet is of.

    Attributes
    ----------
    mirror, rule
        Name or file of each.
    class_name
        Of the rule; None for the one that its file has first in mind.
    vehicle
        Name or file of a scene; without one no fields are measured.
    leg_mm
        Between the spherometer's outer feet; None for what specification or rule have.
    place
        Where the mirror is in its file.
    stated
        What is known of the mirror beside its shape.
    adjust_deg
        Within which a setting is looked for that shows most; without it the scene's own counts.
    """

    mirror: str
    rule: str
    class_name: str | None = None
    vehicle: str | None = None
    leg_mm: float | None = None
    place: Place = "auto"
    stated: StatedProperties = NOTHING_STATED
    adjust_deg: float | None = None


def rules(asked: RuleRequest, out: Path, progress: Progress, pdf: bool = False) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Write rules.json, rules.csv and rules.html into `out`, which is replaced as a whole; returns what rules.json holds, and
    the lines that are missed, in words.

    Raises
    ------
    MirrorError
        With nothing written.
    """
    rule = load_rule(asked.rule)
    class_name = rule.class_named(asked.class_name)
    scene = None if asked.vehicle is None else scene_with_eyes(asked.vehicle)
    if asked.leg_mm is not None and not MIN_LEG_MM <= asked.leg_mm <= LONGEST_LEG_MM:
        raise SpecError(f"--leg-mm {asked.leg_mm:g}: must be from {MIN_LEG_MM:g} to {LONGEST_LEG_MM:g} mm, between the outer "
                        "feet")
    for key, value in (("", asked.stated.reflectance_percent), ("night-", asked.stated.reflectance_night_percent)):
        if value is not None and not 0.0 <= value <= 100.0:
            raise SpecError(f"--reflectance-{key}percent {value:g}: must be from 0 to 100")
    if asked.adjust_deg is not None:
        check_adjustment(asked.adjust_deg, scene is not None)
    if asked.class_name is None:
        progress.step(f"{rule.rule}: class {class_name}, for none was given; the classes are {', '.join(rule.classes)}")
    with new_set(out) as folder:
        progress.step(f"{asked.mirror}: reading")
        name, measured = measured_mirror(asked, rule, scene)
        stated_placement(name, measured.shape.reflector, progress)
        progress.step(f"{name}: {rule.rule}, {rule.edition}, class {class_name}")
        adjustment = None
        try:
            if asked.adjust_deg is not None:
                measured, adjustment = adjusted(measured, class_name, asked.adjust_deg)
            lines = judged(measured, class_name)
            loaded = {line.asked.text: [under_load(measured, line.asked.field, load) for load in loads_of(scene)]
                      for line in lines if line.ground is not None and line.asked.field is not None}
        except TraceError as error:
            raise TraceError(f"{name}: {error}") from None
        content = _content(name, measured, class_name, lines, asked)
        content["adjustment"] = None if adjustment is None else adjustment.as_json()
        for each in content["fields"]:
            each["loads"] = [asdict(load) for load in loaded[each["text"]]]
        write_json(folder / "rules.json", content)
        write_csv(folder / "rules.csv", lines)
        vehicle = None if scene is None else scene.name
        write_sheet(folder / "rules.html", SheetTitle(name, class_name, vehicle), measured, lines, adjustment, loaded)
        if pdf:
            from mirror_studio.report.pdf import write_pdf

            write_pdf(folder / "rules.html", folder / "rules.pdf")
        write_json(folder / MANIFEST, {"schema": 1, "mirror": asked.mirror, "rule": asked.rule, "class": class_name,
                                       "vehicle": vehicle, "versions": versions(), "files": hashes(folder)})
    progress.step(f"done: open {out / 'rules.html'}")
    return content, tuple(_in_words(line) for line in lines if line.verdict == "missed")


def scene_with_eyes(name_or_path: str) -> SceneFile:
    """A scene that says where the driver's eyes are.

    Raises
    ------
    SpecError
        For one that leaves it to defaults.
    """
    scene = load_scene(name_or_path)
    if "middle_m" not in scene.eyes.model_fields_set:
        raise SpecError(f"--vehicle {name_or_path}: the scene has no ocular points: put [eyes] with middle_m = [X, Y, Z] into "
                        "it, 635 mm above the R point for UN R46")
    return scene


def measured_mirror(asked: RuleRequest, rule: RuleFile, scene: SceneFile | None) -> tuple[str, RuleQuantities]:
    """The mirror's name, and what is measured of it."""
    name, reflector, spec = reflector_named(asked.mirror, asked.place)
    own_leg = None if spec is None or spec.rules is None else spec.rules.leg_mm
    leg = next(each for each in (asked.leg_mm, own_leg, rule.leg_mm) if each is not None)
    in_file = reflector.placement is None or reflector.placement.source == "file"
    own = stated_by(spec) if spec is not None else StatedProperties(
        transition_mm=transition_of(Path(asked.mirror)) if in_file else None)
    measured = RuleQuantities.of(reflector, rule, leg, stated=_stated(asked.stated, own))
    measured.shape.outline  # noqa: B018  a face with holes is refused before it is aimed
    if scene is None:
        return name, measured
    try:
        mirror = on_vehicle(name, reflector, scene, spec)
        mounted = Mounted(mirror.pose, mirror.eyes, mirror.host, body_of(scene))
        on_road = RuleQuantities.of(mirror.reflector, rule, leg, mounted, measured.stated)
        on_road.on_vehicle.views  # noqa: B018  an eye that cannot look into it is refused here
    except TraceError as error:
        raise TraceError(f"{name}: {error}") from None
    return name, on_road


def body_of(scene: SceneFile) -> VehicleBody:
    """What of the scene's vehicle hides.

    Raises
    ------
    SpecError
        For a piece that is not flat.
    """
    own = scene.own_vehicle
    opaque, windows = (tuple(Piece(each.name, 1e3 * np.array(each.corners_m)) for each in pieces)
                       for pieces in (own.opaque, own.window))
    for piece in (*opaque, *windows):
        if piece.off_plane_mm > FLAT_MM:
            raise SpecError(f"scene {scene.name!r}: the corners of {piece.name!r} are {piece.off_plane_mm:.0f} mm off one "
                            f"plane, at most {FLAT_MM:g}: cut it into flat pieces")
    return VehicleBody(opaque, windows, scene.mirror.inside)


def loads_of(scene: SceneFile | None) -> tuple[Load, ...]:
    """The loads that the scene has its vehicle under, beside how it stands."""
    return () if scene is None else tuple(Load(each.name, 1e3 * each.front_m, 1e3 * each.rear_m) for each in scene.load)


def _stated(now: StatedProperties, own: StatedProperties) -> StatedProperties:
    """What is known of a mirror beside its shape: what is stated now, and else what its specification or file says."""
    return StatedProperties(**{each.name: getattr(own, each.name) if (value := getattr(now, each.name)) is None else value
                               for each in fields(StatedProperties)})


def _content(name: str, measured: RuleQuantities, class_name: str, lines: Sequence[RuleLine], asked: RuleRequest,
             ) -> dict[str, Any]:
    rule = measured.rule
    leg_checked = rule.leg_checked if measured.readings.leg_mm == rule.leg_mm and asked.leg_mm is None else "stated"
    content: dict[str, Any] = {
        "schema": 1, "mirror": name, "rule": rule.rule, "title": rule.title, "edition": rule.edition, "class": class_name,
        "wording": rule.wording, "spherometer": {"leg_mm": measured.readings.leg_mm, "checked": leg_checked},
        "eyes": {"separation_mm": rule.eyes.separation_mm, "above_r_mm": rule.eyes.above_r_mm, "checked": rule.eyes.checked},
        "vehicle": asked.vehicle, "radii_mm": _readings(measured), "lines": [line.as_json() for line in lines], "fields": []}
    for line in lines:
        if (found := line.ground) is not None:
            content["fields"].append({
                "text": line.asked.text, "missing_m2": found.missing_m2, "missing_to_both_m2": found.missing_to_both_m2,
                "required_m2": found.required_m2, "seen_to_the_horizon": found.horizon, "least_margin_m": found.margin_m,
                "least_margin_at_m": list(found.at_m),
                "missing_m": [(polygon / 1e3).tolist() for polygon in found.missing]})
    return content


def _readings(measured: RuleQuantities) -> list[dict[str, object]]:
    """Each reading, where and what; null where it is flat."""
    radii = measured.radii
    return [{"at_mm": at.tolist(), "readings_mm": [float(r) if abs(r) != float("inf") else None for r in pair]}
            for at, pair in zip(radii.at, radii.readings, strict=True)]


def write_csv(path: Path, lines: Sequence[RuleLine]) -> None:
    """One row a line; empty where there is no number."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["paragraph", "quantity", "value", "unit", "least", "most", "margin", "verdict", "checked", "text",
                         "notes"])
        for line in lines:
            told = line.as_json()
            least, most = (end if abs(end) < float("inf") else None for end in line.limit)
            row = [told["paragraph"], told["quantity"], line.value, told["unit"], least, most, line.margin, line.verdict,
                   told["checked"], told["text"], "; ".join(line.notes)]
            writer.writerow(["" if cell is None else repr(cell) if isinstance(cell, float) else cell for cell in row])


def _in_words(line: RuleLine) -> str:
    asked = line.asked
    value = "no end" if line.value is None else f"{line.value:.6g} {asked.unit}"
    least, most = line.limit
    limit = f"at least {least:g}" if most == float("inf") else f"at most {most:g}" if least in (0.0, -float("inf")) else \
        f"{least:g} to {most:g}"
    return f"{asked.paragraph}: {asked.quantity} = {value}, limit {limit} {asked.unit}"
