"""The command line: `mirror-cad …`. Nothing heavy is imported before a command runs."""

from __future__ import annotations

import json
import os
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import App, CycloptsError, Parameter

from mirror_studio import interrupt

if TYPE_CHECKING:
    from mirror_studio.json_types import JsonObject

DONE, FAILED, BAD_INPUT, MISSED = 0, 1, 2, 3

app = App(
    name="mirror-cad",
    help="Design freeform mirrors on a CAD kernel and see, before anything is made, what they show.",
    version_flags=["--version"],
    suppress_keyboard_interrupt=False,
    help_format="plaintext",  # markdown would double the time to start
    result_action="return_value",
)

Out = Annotated[Path | None, Parameter(name="--out", help="Folder for the files; replaced as a whole.")]
Json = Annotated[bool, Parameter(name="--json", negative=(), help="Print the metrics as JSON to the standard output.")]
Scheduler = Annotated[str | None, Parameter(name="--scheduler", help="Address of a Dask scheduler: tcp://HOST:PORT.")]
Pdf = Annotated[bool, Parameter(name="--pdf", negative=(), help="Write the report as PDF too; needs the extra `pdf`.")]
# Nine numbers may begin with a minus.
PlaceText = Annotated[str, Parameter(name="--place", allow_leading_hyphen=True)]
PlaceTexts = Annotated[list[str] | None, Parameter(name="--place", negative=(), allow_leading_hyphen=True)]
Datum = Annotated[list[str] | None, Parameter(name="--datum", negative=(), allow_leading_hyphen=True)]

Png = Annotated[list[Path] | None, Parameter(name="--png", negative=(), consume_multiple=(0, 1))]
Faces = Annotated[bool, Parameter(name="--faces", negative=(), help="List a CAD file's faces and trace nothing.")]
Parts = Annotated[list[str] | None, Parameter(name="--part", negative=())]


@app.command
def build(spec: str, /, *, out: Out = None, pdf: Pdf = False, json: Json = False) -> int:
    """Build one mirror: STEP, STL, points, outline, deviation, driver's view and report.

    Parameters
    ----------
    spec
        A TOML file, or the name of a preset (progressive-a, sphere-950, …).
    """
    from mirror_cad.spec.file import load_spec
    from mirror_studio.progress import Progress

    loaded = load_spec(spec)
    if pdf:
        from mirror_studio.report.pdf import check_pdf

        check_pdf()
    from mirror_studio.as_json import metrics_as_json
    from mirror_studio.build.pipeline import build as run

    built = run(loaded, out or Path("exports") / loaded.name, Progress(), pdf)
    return _finish(metrics_as_json(built.metrics), built.missed, json)


@app.command
def paper(*, out: Out = None, json: Json = False) -> int:
    """Reproduce the paper: six mirrors, figures 5 and 6, table 1 and a page of it all (default: exports/paper)."""
    from mirror_studio.as_json import table1_as_json
    from mirror_studio.build.paper import build_paper
    from mirror_studio.progress import Progress

    table, missed = build_paper(out or Path("exports/paper"), Progress())
    return _finish(table1_as_json(table), missed, json)


@app.command
def trace(file: Path, /, *, scene: str | None = None, face: str | None = None, faces: Faces = False,
          normals: Literal["facets", "interpolated"] = "facets", place: PlaceText = "auto", out: Out = None,
          json: Json = False) -> int:
    """Trace what the driver sees in a CAD file's faces or a mesh.

    Parameters
    ----------
    file
        A .step, .stp, .iges, .igs, .brep, .brp, .stl, .obj, .ply, .off, .gltf, .glb or .3mf file.
    scene
        A specification or preset that lends [eye], [scene], [view] and the index of [glass]; the defaults without it.
    face
        What reflects in a CAD file: the name of faces, of a part or of a layer, a face's number (1 is the first), or a colour
        as #rrggbb. Without it the "optical face", or all faces where none is named so.
    normals
        Of a mesh: those of its facets, or interpolated between its vertices.
    place
        Where the mirror is in the file: "face", found from the face that reflects; "file", in mirror coordinates; or nine
        numbers in the file's coordinates: origin x,y,z in mm, normal x,y,z towards the driver, up x,y,z. Without it "file" for
        what `mirror-cad build` wrote, "face" for any other.
    """
    if faces:
        from mirror_studio.faces import print_faces

        print_faces(file, json)
        return DONE
    _start_reader([file])
    from mirror_cad.spec.file import load_spec
    from mirror_studio.progress import Progress
    from raytrace.seating import place_from

    lent, where = load_spec(scene or "progressive-c"), place_from(place)
    from mirror_studio.as_json import trace_metrics_as_json
    from mirror_studio.build.pipeline import trace_file

    folder = out or Path("exports") / f"{file.stem}-trace"
    metrics = trace_file(file, lent, folder, Progress(), _chosen_face(face), normals, where)
    return _finish(trace_metrics_as_json(metrics), (), json)


def _start_reader(files: list[Path]) -> None:
    """Start the process that CAD files are read in beside our own imports, where one is among the files."""
    from raytrace.file_kinds import CAD_KINDS

    if any(file.suffix.lower() in CAD_KINDS for file in files):
        from mirror_cad.kernel import start_reader

        start_reader()


def _chosen_face(text: str | None) -> str | int | tuple[int, int, int] | None:
    """A number, a colour #rrggbb, or a name."""
    if text is not None and text.isdecimal():
        return int(text)
    if text is not None and re.fullmatch("#[0-9a-fA-F]{6}", text):
        return int(text[1:3], 16), int(text[3:5], 16), int(text[5:7], 16)
    return text


@app.command
def view(what: str, /, *, out: Out = None, vtp: Path | None = None, png: Png = None) -> int:
    """Open a window with a mirror, its curvature and the rays from the eye, and write them for ParaView.

    Parameters
    ----------
    what
        A TOML file, the name of a preset, or a .step, .stp, .iges, .igs, .brep or .brp file; where its mirror is, is found
        as for `trace`.
    vtp
        A folder or a .vtp file: write mirror.vtp and rays.vtp there and open no window.
    png
        Draw the window into this .png file, or beside the files for ParaView where none is named; needs no display.
    """
    if vtp is not None and (out is not None or png is not None):
        print("mirror-cad: --vtp opens no window and writes to its own folder: without --out and --png", file=sys.stderr)
        return BAD_INPUT
    if vtp is None:
        from mirror_studio.desktop.display import check_display, check_picture

        if png:
            check_picture(png[0])
        check_display(on_screen=png is None)
    from mirror_studio.desktop.paraview import write_vtp
    from mirror_studio.desktop.subject import load_subject

    subject = load_subject(what)
    if vtp is not None:
        write_vtp(subject, vtp)
        return DONE
    from mirror_studio.desktop.window import open_window

    beside = png is not None and not png
    write_vtp(subject, out or Path("exports") / f"{subject.name}-view", open_window if beside else None)
    if not beside:
        open_window(subject, png[0] if png else None)
    return DONE


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
    _start_reader([Path(each) for each in mirror])
    from mirror_studio.progress import Progress
    from mirror_studio.scene_file import load_scene

    loaded = load_scene(scene)
    from mirror_studio.drive.mirrors import placements_of
    from mirror_studio.drive.run import drive as run

    placements = placements_of(mirror, place or [])
    return _finish(run(mirror, loaded, out or Path("exports") / f"drive-{loaded.name}", Progress(), placements), (), json)


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

    return _finish(write_reference(loaded, out or Path("exports") / f"reference-{loaded.name}", Progress()), (), json)


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
    _start_reader([Path(mirror)])
    if pdf:
        from mirror_studio.report.pdf import check_pdf

        check_pdf()
    from mirror_studio.progress import Progress
    from mirror_studio.rules.measuring import Told
    from mirror_studio.rules.run import Asked
    from mirror_studio.rules.run import rules as run
    from raytrace.seating import place_from

    asked = Asked(mirror, rule, class_, vehicle, leg_mm, place_from(place),
                  Told(reflectance_percent, reflectance_night_percent, transition_mm), adjust_deg)
    content, missed = run(asked, out or Path("exports") / f"{Path(mirror).stem}-rules", Progress(), pdf)
    return _finish(content, missed, json)


@app.command
def inspect(data: list[Path], /, *, against: str | None = None, align: Literal["none", "321", "best-fit"] = "best-fit",
            sigma_mm: float | None = None, gauge_mm: float | None = None, scene: str | None = None,
            datum: Datum = None, out: Out = None, pdf: Pdf = False, json: Json = False) -> int:
    """Lay the measured points of a made mirror on its design: deviation of curvature, slope and height, each with its sigma.

    Parameters
    ----------
    data
        Points as CSV, TSV, XYZ or TXT, a mesh, or a CAD file of a surface that was made from points; and with or instead of
        them slopes, curvatures and spherometer readings as tables, in mirror coordinates.
    against
        The design: a preset, a specification, or a STEP file. Without it the mirror is told against its nearest sphere, and
        the laws that it seems to follow are written as a specification.
    align
        Take the points as they are, by three datum points, or by the best fit to the exact surface.
    sigma_mm
        Standard uncertainty of a point along the surface's normal; from the points' own scatter without it.
    gauge_mm
        Over which slope and curvature are told; without it 38, a spherometer's.
    scene
        A scene's name, or a TOML file: the measures of the mirror on its vehicle are taken too, with their intervals.
    datum
        X,Y of a place that `--align 321` lays the mirror on, mm in mirror coordinates; given three times.
    """
    _start_reader([*data, *([] if against is None else [Path(against)])])
    if pdf:
        from mirror_studio.report.pdf import check_pdf

        check_pdf()
    from mirror_studio.inspect.run import Asked, datums_from
    from mirror_studio.inspect.run import inspect_file as run
    from mirror_studio.progress import Progress

    asked = Asked(tuple(data), against, align, sigma_mm, gauge_mm, scene, datums_from(datum or ()))
    content, missed = run(asked, out or Path("exports") / f"{data[0].stem}-inspection", Progress(), pdf)
    return _finish(content, missed, json)


@app.command
def compensate(data: list[Path], /, *, against: str, mould: Path | None = None, gain: float = 1.0, springback: float = 1.0,
               shrink_percent: float = 0.0, offset_mm: float = 0.0,
               align: Literal["none", "321", "best-fit"] = "best-fit", sigma_mm: float | None = None, out: Out = None,
               json: Json = False) -> int:
    """Work out the next mould from measured mirrors of the last one: what they deviate by is taken away from it.

    Parameters
    ----------
    data
        Points of one or more mirrors of one mould, a file each.
    against
        The design: a preset, a specification, or a STEP file.
    mould
        STEP file of the mould that they were made on; without it the one that follows from the design.
    gain
        How much of the deviation is taken away at once.
    springback
        By how much the glass follows a change of its mould; 1 is wholly.
    shrink_percent
        By how much the mould is larger than the glass that comes from it.
    offset_mm
        The glass between the mould and the optical face: its thickness, where the mould lies behind it.
    align
        How the points are laid on the design, as for `inspect`. A best fit hides what a motion of the mirror would look like.
    sigma_mm
        Standard uncertainty of a point along the surface's normal; from the points' own scatter without it.
    """
    _start_reader([*data, Path(against), *([] if mould is None else [mould])])
    from mirror_studio.inspect.compensate import Asked
    from mirror_studio.inspect.compensate import compensate as run
    from mirror_studio.progress import Progress

    asked = Asked(tuple(data), against, mould, gain, springback, shrink_percent, offset_mm, align, sigma_mm)
    return _finish(run(asked, out or Path("exports") / f"{data[0].stem}-mould", Progress()), (), json)


@app.command
def measures(*, json: Json = False) -> int:
    """List the measures by name: unit, what they are of, and their definitions; the figures of rules after them."""
    from mirror_studio.rules.figures import rule_figures_known
    from raytrace.measures.registry import registered

    found = {name: {"title": one.title, "unit": one.unit, "of": one.scope, "better": one.better, "definition": one.definition}
             for name, one in registered().items()}
    found |= {name: {"title": "rule of the road", "unit": unit, "of": "rule", "better": None, "definition": definition}
              for name, (unit, definition) in rule_figures_known().items()}
    if json:
        return _finish(found, (), json)
    for name, one in found.items():
        print(f"{name:34} {one['unit'] or '1':10} {one['title']}: {one['definition']}")
    return DONE


@app.command
def sweep(study: Path, /, *, out: Out = None, scheduler: Scheduler = None, json: Json = False) -> int:
    """Take measures of many designs: a grid, lists or samples of any keys of a specification. The same command goes on.

    Parameters
    ----------
    study
        A TOML file: spec, scene, measures, [vary].
    """
    if (missing := _missing_for_studies()) is not None:
        return missing
    from mirror_studio.explore.study import load_study
    from mirror_studio.explore.sweep import sweep as run
    from mirror_studio.progress import Progress

    loaded = load_study(study)
    return _finish(run(loaded, out or Path("exports") / study.stem, Progress(), scheduler), (), json)


@app.command
def optimise(study: Path, /, *, out: Out = None, scheduler: Scheduler = None, json: Json = False) -> int:
    """Look for the best designs, or for the front between several wishes. The same command goes on where it ended.

    Parameters
    ----------
    study
        A TOML file: spec, scene, [vary], [optimise].
    """
    if (missing := _missing_for_studies()) is not None:
        return missing
    from mirror_studio.explore.optimise import optimise as run
    from mirror_studio.explore.study import load_study
    from mirror_studio.progress import Progress

    loaded = load_study(study, optimise=True)
    found = run(loaded, out or Path("exports") / study.stem, Progress(), scheduler)
    missed: tuple[str, ...] = ()
    if not found.front:
        near = found.nearest
        missed = ("no design meets optimise.limits" + ("" if near is None else "; the nearest has " + ", ".join(
            f"{key} = {value}" for key, value in zip(loaded.keys, near[0].values, strict=True)) + ", and misses " + ", ".join(
            f"{name} by {100.0 * share:.3g} % of its limit" for name, share in near[1].items())),)
    return _finish({"evaluations": found.evaluations, "failed": found.failed, "front": len(found.front)}, missed, json)


@app.command
def tolerances(study: Path, /, *, out: Out = None, scheduler: Scheduler = None, json: Json = False) -> int:
    """Make many mirrors as they may come out, and say how far each measure spreads and which tolerance brings how much of it.

    Parameters
    ----------
    study
        A TOML file: spec, scene, measures, [limits], and what may depart: [keys], [form], [wedge], [aim], [eye].
    """
    if (missing := _missing_for_studies()) is not None:
        return missing
    from mirror_studio.progress import Progress
    from mirror_studio.tolerances.file import load_tolerances
    from mirror_studio.tolerances.run import tolerances as run

    content, missed = run(load_tolerances(study), out or Path("exports") / study.stem, Progress(), scheduler)
    return _finish(content, missed, json)


def _missing_for_studies() -> int | None:
    """The exit code where what studies need is not installed, said; None where it is."""
    from importlib.util import find_spec

    for package in ("distributed", "pymoo", "pyarrow"):
        if find_spec(package) is None:
            print(f"mirror-cad: studies need {package}: install the project with its extra \"studies\"", file=sys.stderr)
            return BAD_INPUT
    return None


@app.command
def bench(*, part: Parts = None, out: Out = None, json: Json = False) -> int:
    """Measure speed against error: tables, plots and a page (default: exports/bench).

    Parameters
    ----------
    part
        A part to measure; may be given several times. All without it.
    """
    from mirror_studio.bench.run import run_bench
    from mirror_studio.progress import Progress

    return _finish(run_bench(part or (), out or Path("exports/bench"), Progress()), (), json)


@app.command
def studio(*, port: int = 8642, browser: bool = True, study: Path | None = None) -> int:
    """Design by hand: a page on this machine on which a radius is dragged and the road bends.

    Parameters
    ----------
    port
        Where it listens on 127.0.0.1; 0 takes any free one.
    browser
        Whether to open the page, where there is a screen.
    study
        The directory of an optimisation: its front is on the page, and dragging along it shows its designs.
    """
    try:
        from mirror_studio.web.server import BadPortError, serve
    except ModuleNotFoundError as error:
        if error.name not in ("starlette", "uvicorn", "websockets"):
            raise
        print(f"mirror-cad: the studio needs {error.name}: install the project with its extra \"studio\"", file=sys.stderr)
        return BAD_INPUT
    try:
        serve(port, browser, study)
    except BadPortError as error:
        print(f"mirror-cad: {error}", file=sys.stderr)
        return BAD_INPUT
    return DONE


def _finish(metrics: JsonObject, missed: tuple[str, ...], as_json: bool) -> int:
    if as_json:
        print(json.dumps(metrics, indent=2, ensure_ascii=False))
    for text in missed:
        print(f"mirror-cad: missed: {text}", file=sys.stderr)
    return MISSED if missed else DONE


def main(arguments: list[str] | None = None) -> None:
    """Run a command and leave with its exit code: 0 done, 2 bad input, 3 done but something asked for is missed, 1 else."""
    for name in ("stdout", "stderr"):  # closed by whoever started us: then nobody reads
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115
    # Sums that threads share are rounded by how many there are, and figures are to be the same on every machine. Matrices are
    # of a few hundred rows at most: a second thread brings little, and the tracer wants the cores.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # A polite end is an interrupt: what was begun is cleared away.
    interrupt.install()
    code = run(arguments)
    if interrupt.asked():
        interrupt.leave(code)
    sys.exit(code)


def run(arguments: list[str] | None = None) -> int:
    """Run a command; returns its exit code."""
    try:
        result = app(arguments, print_error=False, exit_on_error=False)
        return result if isinstance(result, int) else DONE
    except CycloptsError as error:
        print(f"mirror-cad: {' '.join(str(error).split())}\n`mirror-cad --help` lists commands and options.", file=sys.stderr)
        return BAD_INPUT
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except KeyboardInterrupt:
        return _stopped()
    except ImportError as error:
        if interrupt.asked():
            return _stopped()
        print(f"mirror-cad: a part of the installation cannot be loaded: {error}", file=sys.stderr)
        return FAILED
    except Exception as error:
        return _stopped() if interrupt.asked() else _report(error)


def _stopped() -> int:
    print(interrupt.STOPPED, file=sys.stderr)
    return FAILED


def _report(error: Exception) -> int:
    """Say what went wrong without a traceback; MIRROR_CAD_TRACEBACK=1 shows it."""
    from mirror_cad.errors import MirrorError, WriteError

    if os.environ.get("MIRROR_CAD_TRACEBACK"):
        raise error
    if not isinstance(error, MirrorError):
        print(f"mirror-cad: internal error: {type(error).__name__}: {error}\nPlease report it; MIRROR_CAD_TRACEBACK=1 shows "
              "where it arose.", file=sys.stderr)
        return FAILED
    for line in str(error).splitlines():
        print(f"mirror-cad: {line}", file=sys.stderr)
    return FAILED if isinstance(error, WriteError) else BAD_INPUT
