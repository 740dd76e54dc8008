"""A measured mirror and its design in, the inspection's set of files out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import SpecError
from mirror_cad.made.datums import Datums
from mirror_cad.made.figures import Figures, figures
from mirror_cad.made.hidden_form import hidden_form
from mirror_cad.made.inspection import GAUGE_MM, Align, Inspection, inspect
from mirror_cad.made.measured_surface import measured_surface
from mirror_cad.made.motion import Motion
from mirror_cad.made.verdict import Verdict, verdict
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_studio.build.folder import MANIFEST, new_set
from mirror_studio.build.pipeline import hashes, versions, write_json
from mirror_studio.inspect.alone import NearestSphere, reference_of_points, write_laws
from mirror_studio.inspect.as_json import hidden_as_json, inspection_as_json, view_as_json
from mirror_studio.inspect.data import MeasuredPoints, read_points, read_table
from mirror_studio.inspect.driver import drivers_view
from mirror_studio.inspect.others import OtherData, joined, kind_of, other_data
from mirror_studio.inspect.probes import probe_places
from mirror_studio.inspect.reference import Reference, load_reference
from mirror_studio.inspect.sheet import basis, write_sheet
from mirror_studio.inspect.tables import write_maps, write_residuals
from mirror_studio.json_types import JsonObject
from mirror_studio.progress import Progress
from mirror_studio.scene_file import load_scene

Array = NDArray[np.float64]

SEEN_SHARE = 0.97  # of the mirror: with less of it measured, what a driver sees in it is not known
LARGEST_SIGMA_MM = 10.0
MIN_GAUGE_MM = 0.1


@dataclass(frozen=True, slots=True)
class InspectionRequest:
    """What one inspection is of.

    Attributes
    ----------
    data : tuple of Path
        The measured files: one of points, and any of slopes, curvatures and readings.
    against : str or None
        A preset, a specification or a STEP file; None for a mirror without a design.
    align : str
        How the points are laid on the design.
    sigma_mm : float or None
        Of a point along the normal.
    gauge_mm : float or None
        Over which curvature is told; GAUGE_MM without it.
    scene : str or None
        On whose vehicle the driver looks into the mirror too.
    datums : tuple or None
        The three places (x, y), mm, that `align = "321"` lays the mirror on.
    """

    data: tuple[Path, ...]
    against: str | None
    align: Align = "best-fit"
    sigma_mm: float | None = None
    gauge_mm: float | None = None
    scene: str | None = None
    datums: Datums | None = None


def inspect_file(asked: InspectionRequest, out: Path, progress: Progress, pdf: bool = False,
                 ) -> tuple[JsonObject, tuple[str, ...]]:
    """Write the set of an inspection into `out`, which is replaced as a whole.

    Parameters
    ----------
    asked : InspectionRequest
        What it is of.
    out : Path
        The folder.
    progress : Progress
        Told what is being done.
    pdf : bool
        Whether to print the report too.

    Returns
    -------
    content : dict
        What inspection.json holds.
    missed : tuple of str
        A sentence where the mirror fails its limit.

    Raises
    ------
    MirrorError
        With nothing written.
    """
    _check(asked)
    if asked.against is None:
        return _alone(asked, out, progress, pdf)
    progress.step(f"{asked.against}: reading the design")
    reference = load_reference(asked.against)
    read, others = _read(asked, reference, progress)
    return _inspected(asked, reference, read, others, None, out, progress, pdf)


def _alone(asked: InspectionRequest, out: Path, progress: Progress, pdf: bool) -> tuple[JsonObject, tuple[str, ...]]:
    """An inspection against the nearest sphere."""
    if len(asked.data) != 1:
        raise SpecError("without --against one file of points is inspected: slopes, curvatures and readings need a design")
    path = asked.data[0]
    progress.step(f"{path.name}: reading")
    table = read_table(path)
    if table is not None and kind_of(table) != "points":
        raise SpecError(f"{path}: without --against only points tell a mirror: give the design with --against")
    read = read_points(path, table, None)
    reference, sphere = reference_of_points(path.stem, read.points)
    progress.step(f"{path.name}: nearest " + ("plane" if sphere.radius_mm is None else f"sphere {sphere.radius_mm:.2f} mm"))
    return _inspected(replace(asked, align="none"), reference, read, [], sphere, out, progress, pdf)


def _inspected(asked: InspectionRequest, reference: Reference, read: MeasuredPoints, others: list[OtherData],
               sphere: NearestSphere | None, out: Path, progress: Progress, pdf: bool) -> tuple[JsonObject, tuple[str, ...]]:
    """The set of an inspection of what was read."""
    against = asked.against or "the nearest " + ("plane" if sphere is None or sphere.radius_mm is None else
                                                 f"sphere, {sphere.radius_mm:.2f} mm")
    for note in (*read.notes, *(note for each in others for note in each.notes)):
        progress.step(f"note: {note}")
    sigmas = read.sigmas if asked.sigma_mm is None else np.full(len(read.points), asked.sigma_mm)
    progress.step(f"{len(read.points)} points: alignment and surface")
    extra, readings = joined(others)
    found = inspect(reference.nominal, read.points, sigmas, asked.align, asked.gauge_mm or GAUGE_MM, reference.given, extra,
                    readings, asked.datums)
    main, judged = figures(reference.nominal, found.fields), None
    if reference.limit_percent is not None and not found.fields.flat:
        judged = verdict(found.fields, reference.limit_percent)
    left_out = dict(found.left_out) | ({"not numbers": read.not_numbers} if read.not_numbers else {})
    if beside := sum(each.left_out for each in others):
        left_out["other data beside the mirror"] = beside
    notes = (*read.notes, *(note for each in others for note in each.notes), *_remarks(found, main))
    source = ", ".join(str(each) for each in asked.data)
    name = reference.name
    with new_set(out) as folder:
        progress.step(f"{name}: files")
        content = inspection_as_json(name, found, left_out, main, judged, _to_file(reference, found.motion), notes)
        write_residuals(folder / f"{name}-residuals.csv", found)
        surface = measured_surface(reference.nominal, found.reconstruction.smooth)
        write_measured_step(folder / f"{name}-measured.step", reference, surface)
        if sphere is not None:
            content["sphere"] = {"radius_mm": sphere.radius_mm, "rms_mm": sphere.rms_mm}
            content["laws"] = write_laws(folder, name, found)
        probe_places(found).write(folder / f"{name}-probes.csv")
        hidden = hidden_form(found, reference.given)
        content["hidden_by_alignment"] = hidden_as_json(hidden, found)
        view = None
        if main.measured_share >= SEEN_SHARE:
            progress.step(f"{name}: what the driver sees")
            view = drivers_view(reference, found.fields.lattice, found.reconstruction.smooth, found.reconstruction.sigma_factor,
                                asked.scene)
            content["driver"] = view_as_json(view, found.fields.lattice)
        write_json(folder / "inspection.json", content)
        write_maps(folder / f"{name}-maps.csv", found, view)
        facts = basis(found, source, against)
        write_sheet(folder / "report.html", f"{name}: inspection of a made mirror", facts, found, main, judged, view, hidden,
                    notes)
        if pdf:
            from mirror_studio.report.pdf import write_pdf

            write_pdf(folder / "report.html", folder / "report.pdf")
        write_json(folder / MANIFEST, {"schema": 1, "measured": source, "against": against, "align": asked.align,
                                       "versions": versions(), "files": hashes(folder)})
    progress.step(f"done: open {out / 'report.html'}")
    return content, _missed(judged, main)


def _read(asked: InspectionRequest, reference: Reference, progress: Progress) -> tuple[MeasuredPoints, list[OtherData]]:
    """The points of the one file that holds some, and what the other files hold."""
    points: MeasuredPoints | None = None
    others = []
    for path in asked.data:
        progress.step(f"{path.name}: reading")
        table = read_table(path)
        if table is not None and (kind := kind_of(table)) != "points":
            level = kind == "slopes" and asked.align == "best-fit"
            others.append(other_data(table, reference.nominal, asked.gauge_mm or GAUGE_MM, level))
        elif points is not None:
            raise SpecError(f"{path}: a second file of points: inspect one mirror's points at a time, or join the files")
        else:
            points = read_points(path, table, reference.nominal)
    if points is None:
        if all(each.observations is None for each in others):
            raise SpecError("readings alone tell curvature where the instrument stood and no surface: give points, slopes or "
                            "curvatures with them")
        points = MeasuredPoints(np.zeros((0, 3)), None, 0, ())
    return points, others


def datums_from(texts: Sequence[str]) -> Datums | None:
    """Read three places, each as X,Y in mm; None for no text.

    Parameters
    ----------
    texts : sequence of str
        As a command line has them.

    Raises
    ------
    SpecError
        For what are not three places.
    """
    if not texts:
        return None
    places = []
    for text in texts:
        try:
            x, y = (float(each) for each in text.split(","))
        except ValueError:
            raise SpecError(f"--datum {text}: must be X,Y, two numbers in mm") from None
        if not (np.isfinite(x) and np.isfinite(y)):
            raise SpecError(f"--datum {text}: must be two finite numbers in mm")
        places.append((x, y))
    if len(places) != 3:
        raise SpecError(f"--datum: {len(places)} given: 321 lays a mirror on three places")
    return places[0], places[1], places[2]


def write_measured_step(path: Path, reference: Reference, surface: BSplineSurface) -> None:
    """Write the measured surface inside the design's outline, in the coordinates of the design's own file.

    Parameters
    ----------
    path : Path
        Of the file.
    reference : Reference
        The design.
    surface : BSplineSurface
        u = x, v = y in mirror coordinates.
    """
    from mirror_cad.occt.solid import trimmed_sheet
    from mirror_cad.occt.step import OPTICAL_COLOUR, OPTICAL_FACE, Part, write_step

    poles = (surface.poles - reference.given.translation) @ reference.given.rotation
    placed = BSplineSurface(surface.degree_u, surface.degree_v, surface.knots_u, surface.knots_v, np.ascontiguousarray(poles))
    shell, face = trimmed_sheet(placed, reference.nominal.outline)
    hand = None if reference.spec is None else reference.spec.part.hand
    write_step(path, [Part(shell, f"{reference.name}-measured", OPTICAL_COLOUR, {OPTICAL_FACE: face})],
               f"{reference.name}-measured", hand)


def _to_file(reference: Reference, motion: Motion) -> Motion:
    """A motion to mirror coordinates as one to those of the design's file."""
    back = reference.given.rotation.T
    return Motion(back @ motion.rotation, back @ (motion.translation - reference.given.translation), motion.reflected)


def _check(asked: InspectionRequest) -> None:
    if asked.sigma_mm is not None and not 0.0 < asked.sigma_mm <= LARGEST_SIGMA_MM:
        raise SpecError(f"--sigma-mm {asked.sigma_mm:g}: must be above 0 and at most {LARGEST_SIGMA_MM:g} mm")
    if asked.gauge_mm is not None and not MIN_GAUGE_MM <= asked.gauge_mm < np.inf:
        raise SpecError(f"--gauge-mm {asked.gauge_mm:g}: must be {MIN_GAUGE_MM:g} mm or more")
    if asked.datums is not None and asked.align != "321":
        raise SpecError("--datum belongs to --align 321")
    if asked.scene is not None:
        load_scene(asked.scene)
    for path in asked.data:
        if not path.is_file():
            raise SpecError(f"{path}: no such file")


def _remarks(found: Inspection, main: Figures) -> list[str]:
    remarks = []
    if not len(found.points):
        remarks.append("no heights were measured: the mean height of the deviation, and without slopes its mean tilt, are "
                       "set to nought")
    if found.motion.reflected:
        remarks.append("the points are those of the other hand's mirror: they were reflected in x = 0 before they were laid "
                       "on the design")
    if not found.fields.fits.any():
        remarks.append(f"a gauge of {found.fields.gauge_mm:g} mm fits nowhere on the mirror: curvature is not known; take a "
                       "shorter one with --gauge-mm")
    elif not found.fields.known.any():
        remarks.append(f"nowhere do measured points lie close enough for a gauge of {found.fields.gauge_mm:g} mm to stand on: "
                       f"curvature is not known. The points are about {found.reconstruction.coverage.spacing_mm:.3g} mm "
                       "apart: a gauge of eight times that tells it where they cover an area")
    if main.measured_share < SEEN_SHARE:
        remarks.append(f"{100.0 * (1.0 - main.measured_share):.0f} % of the mirror were not measured: what the driver sees in "
                       "it is not known. There the STEP file follows the design")
    if found.fields.known.any() and main.known_share < 0.99:
        remarks.append(f"of the places where the gauge fits on the mirror {100.0 * (1.0 - main.known_share):.0f} % are not "
                       "known: too few points lie there")
    if found.sigma_stated and found.reconstruction.sigma_factor > 1.2:
        remarks.append(f"the residuals are {found.reconstruction.sigma_factor:.2g} times what the stated sigma lets expect: "
                       "all sigmas of the report count with the residuals")
    return remarks


def _missed(judged: Verdict | None, main: Figures) -> tuple[str, ...]:
    if judged is None or judged.outcome != "fail":
        return ()
    worst = max(("k1", "k2"), key=lambda key: abs(main.percent[key].largest or 0.0))  # type: ignore[index]
    figure = main.percent[worst]  # type: ignore[index]
    return (f"{worst}: {figure.largest:+.3g} % at ({figure.at_mm[0]:.1f}, {figure.at_mm[1]:.1f}) mm, "  # type: ignore[index]
            f"sigma {figure.sigma_at_largest:.2g} %, the limit is {judged.limit_percent:g} %",)
