"""One mirror: its files, the paper's six, what an eye sees in a file's mirror, and a window with it."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from mirror_studio.commands.app import BAD_INPUT, DONE, Json, Out, Pdf, PlaceText, app, finish, start_cad_reader

Png = Annotated[list[Path] | None, Parameter(name="--png", negative=(), consume_multiple=(0, 1))]
Faces = Annotated[bool, Parameter(name="--faces", negative=(), help="List a CAD file's faces and trace nothing.")]


@app.command
def build(spec: str, /, *, out: Out = None, pdf: Pdf = False, json: Json = False) -> int:
    """Build one mirror: STEP, STL, points, outline, deviation, driver's view and report.

    Parameters
    ----------
    spec
        A TOML file, or the name of a preset (progressive-a, sphere-950, …).
    """
    from mirror_cad.kernel import start_writer

    start_writer()
    from mirror_cad.spec.file import load_spec
    from mirror_studio.progress import Progress

    loaded = load_spec(spec)
    if pdf:
        from mirror_studio.report.pdf import check_pdf

        check_pdf()
    from mirror_studio.compiling import compile_beside

    compile_beside()
    from mirror_studio.as_json import metrics_as_json
    from mirror_studio.build.pipeline import build as run

    built = run(loaded, out or Path("exports") / loaded.name, Progress(), pdf)
    return finish(metrics_as_json(built.metrics), built.missed, json)


@app.command
def paper(*, out: Out = None, json: Json = False) -> int:
    """Reproduce the paper: six mirrors, figures 5 and 6, table 1 and a page of it all (default: exports/paper)."""
    from mirror_cad.kernel import start_writer

    start_writer()
    from mirror_studio.compiling import compile_beside

    compile_beside()
    from mirror_studio.as_json import table1_as_json
    from mirror_studio.build.paper import build_paper
    from mirror_studio.progress import Progress

    table, missed = build_paper(out or Path("exports/paper"), Progress())
    return finish(table1_as_json(table), missed, json)


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
    start_cad_reader([file])
    from mirror_cad.spec.file import load_spec
    from mirror_studio.progress import Progress
    from raytrace.seating import place_from

    lent, where = load_spec(scene or "progressive-c"), place_from(place)
    from mirror_studio.compiling import compile_beside

    compile_beside()
    from mirror_studio.as_json import trace_metrics_as_json
    from mirror_studio.build.pipeline import trace_file

    folder = out or Path("exports") / f"{file.stem}-trace"
    metrics = trace_file(file, lent, folder, Progress(), _chosen_face(face), normals, where)
    return finish(trace_metrics_as_json(metrics), (), json)


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
