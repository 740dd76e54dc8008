"""Mirrors on a vehicle: the drive, the picture that a design can be taken from, and what rules ask."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mirror_studio.commands.app import Json, Out, Pdf, PlaceText, app, finish, start_cad_reader

PlaceTexts = Annotated[list[str] | None, Parameter(name="--place", negative=(), allow_leading_hyphen=True)]


@app.command
def drive(mirror: list[str], /, *, scene: str = "motorway", place: PlaceTexts = None, out: Out = None,
          json: Json = False) -> int:
    """Put mirrors on a vehicle on the road, aim them alike, and set what both eyes see and all measures side by side.

    Parameters
    ----------
    mirror
        Presets, specifications, CAD or mesh files.
    scene
        A scene's name, or a TOML file in metres.
    place
        Where the mirror is in its file, as for `trace`; FILE=PLACE says it for one of several files.
    """
    start_cad_reader([Path(each) for each in mirror], designed=True)
    from mirror_studio.progress import Progress
    from mirror_studio.scene_file import load_scene

    loaded = load_scene(scene)
    from mirror_studio.drive.mirrors import placements_of
    from mirror_studio.drive.run import drive as run

    placements = placements_of(mirror, place or [])
    return finish(run(mirror, loaded, out or Path("exports") / f"drive-{loaded.name}", Progress(), placements), (), json)


@app.command
def photograph(scene: str = "motorway", /, *, out: Out = None, json: Json = False) -> int:
    """Photograph a scene from the mirror's place: a picture for the paper's reference plane, and a specification with it.

    Parameters
    ----------
    scene
        A scene's name, or a TOML file in metres.
    """
    from mirror_studio.progress import Progress
    from mirror_studio.scene_file import load_scene

    loaded = load_scene(scene)
    from mirror_studio.drive.reference import write_reference

    return finish(write_reference(loaded, out or Path("exports") / f"reference-{loaded.name}", Progress()), (), json)


@app.command
def rules(mirror: str, /, *, rule: str, class_: Annotated[str | None, Parameter(name="--class")] = None,
          vehicle: str | None = None, leg_mm: float | None = None, transition_mm: float | None = None,
          reflectance_percent: float | None = None, reflectance_night_percent: float | None = None,
          adjust_deg: float | None = None, place: PlaceText = "auto", out: Out = None, pdf: Pdf = False,
          json: Json = False) -> int:
    """Set what a rule of the road asks of a mirror beside what is measured of it, line by line; the official text decides.

    Parameters
    ----------
    mirror
        A preset, a specification, a CAD or mesh file.
    rule
        R46, GB15084, FMVSS111, another of the package's rule files (r46-04), or a TOML file.
    class_
        I to VII; of FMVSS111 driver, passenger or inside. Without it, the one that the rule's file names.
    vehicle
        A scene's name or TOML file with the driver's eyes: fields of vision are measured on it, and left open without it.
    leg_mm
        Between the spherometer's outer feet; without it, what the rule's file has.
    transition_mm
        x of the line beyond which, outboard, an aspheric part lies, in mirror coordinates.
    reflectance_percent, reflectance_night_percent
        As measured by the mirror's maker, by day and in the night position.
    adjust_deg
        Within which yaw and pitch beside the scene's are looked for that show most of the fields, and their range.
    place
        Where the mirror is in its file, as for `trace`.
    """
    start_cad_reader([Path(mirror)], designed=True)
    if pdf:
        from mirror_studio.report.pdf import check_pdf

        check_pdf()
    from mirror_studio.progress import Progress
    from mirror_studio.rules.measuring import StatedProperties
    from mirror_studio.rules.run import RuleRequest
    from mirror_studio.rules.run import rules as run
    from raytrace.seating import place_from

    asked = RuleRequest(mirror, rule, class_, vehicle, leg_mm, place_from(place),
                        StatedProperties(reflectance_percent, reflectance_night_percent, transition_mm), adjust_deg)
    content, missed = run(asked, out or Path("exports") / f"{Path(mirror).stem}-rules", Progress(), pdf)
    return finish(content, missed, json)
