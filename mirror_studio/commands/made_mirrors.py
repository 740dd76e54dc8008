"""Mirrors that were made: what their points say, and the next mould."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from mirror_studio.commands.app import Json, Out, Pdf, app, finish, start_cad_reader

Datum = Annotated[list[str] | None, Parameter(name="--datum", negative=(), allow_leading_hyphen=True)]


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
    start_cad_reader([*data, *([] if against is None else [Path(against)])])
    if pdf:
        from mirror_studio.report.pdf import check_pdf

        check_pdf()
    from mirror_studio.inspect.run import InspectionRequest, datums_from
    from mirror_studio.inspect.run import inspect_file as run
    from mirror_studio.progress import Progress

    asked = InspectionRequest(tuple(data), against, align, sigma_mm, gauge_mm, scene, datums_from(datum or ()))
    content, missed = run(asked, out or Path("exports") / f"{data[0].stem}-inspection", Progress(), pdf)
    return finish(content, missed, json)


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
    start_cad_reader([*data, Path(against), *([] if mould is None else [mould])])
    from mirror_studio.inspect.compensate import CompensationRequest
    from mirror_studio.inspect.compensate import compensate as run
    from mirror_studio.progress import Progress

    asked = CompensationRequest(tuple(data), against, mould, gain, springback, shrink_percent, offset_mm, align, sigma_mm)
    return finish(run(asked, out or Path("exports") / f"{data[0].stem}-mould", Progress()), (), json)
