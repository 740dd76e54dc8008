"""A measured mirror and its design in, the inspection's set of files out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import SpecError
from mirror_cad.made.figures import Figures, figures
from mirror_cad.made.inspection import GAUGE_MM, Align, Inspection, inspect
from mirror_cad.made.measured_surface import measured_surface
from mirror_cad.made.motion import Motion
from mirror_cad.made.verdict import Verdict, verdict
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_studio.as_json import JsonObject
from mirror_studio.build.folder import MANIFEST, new_set
from mirror_studio.build.pipeline import hashes, versions, write_json
from mirror_studio.inspect.as_json import inspection_as_json, view_as_json
from mirror_studio.inspect.data import read_points
from mirror_studio.inspect.driver import drivers_view
from mirror_studio.inspect.reference import Reference, load_reference
from mirror_studio.inspect.sheet import basis, write_sheet
from mirror_studio.inspect.tables import write_maps, write_residuals
from mirror_studio.progress import Progress

Array = NDArray[np.float64]

SEEN_SHARE = 0.97  # of the mirror: with less of it measured, what a driver sees in it is not known
LARGEST_SIGMA_MM = 10.0
LEAST_GAUGE_MM = 0.1


@dataclass(frozen=True, slots=True)
class Asked:
    """What one inspection is of.

    Attributes
    ----------
    data : Path
        The measured file.
    against : str
        A preset, a specification or a STEP file.
    align : str
        How the points are laid on the design.
    sigma_mm : float or None
        Of a point along the normal.
    gauge_mm : float or None
        Over which curvature is told; GAUGE_MM without it.
    """

    data: Path
    against: str
    align: Align = "best-fit"
    sigma_mm: float | None = None
    gauge_mm: float | None = None


def inspect_file(asked: Asked, out: Path, progress: Progress, pdf: bool = False) -> tuple[JsonObject, tuple[str, ...]]:
    """Write the set of an inspection into `out`, which is replaced as a whole.

    Parameters
    ----------
    asked : Asked
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
    progress.step(f"{asked.against}: reading the design")
    reference = load_reference(asked.against)
    progress.step(f"{asked.data.name}: reading")
    read = read_points(asked.data, reference.nominal)
    for note in read.notes:
        progress.step(f"{asked.data.name}: note: {note}")
    sigmas = read.sigmas if asked.sigma_mm is None else np.full(len(read.points), asked.sigma_mm)
    progress.step(f"{asked.data.name}: {len(read.points)} points: alignment and surface")
    found = inspect(reference.nominal, read.points, sigmas, asked.align, asked.gauge_mm or GAUGE_MM, reference.given)
    main, judged = figures(reference.nominal, found.fields), None
    if reference.limit_percent is not None and not found.fields.flat:
        judged = verdict(found.fields, reference.limit_percent)
    left_out = dict(found.left_out) | ({"not numbers": read.not_numbers} if read.not_numbers else {})
    notes = (*read.notes, *_remarks(found, main))
    name = reference.name
    with new_set(out) as folder:
        progress.step(f"{name}: files")
        content = inspection_as_json(name, found, left_out, main, judged, _to_file(reference, found.motion), notes)
        write_residuals(folder / f"{name}-residuals.csv", found)
        surface = measured_surface(reference.nominal, found.reconstruction.smooth)
        write_measured_step(folder / f"{name}-measured.step", reference, surface)
        view = None
        if main.measured_share >= SEEN_SHARE:
            progress.step(f"{name}: what the driver sees")
            view = drivers_view(reference, found.fields.lattice, found.reconstruction.smooth, found.reconstruction.sigma_factor)
            content["driver"] = view_as_json(view, found.fields.lattice)
        write_json(folder / "inspection.json", content)
        write_maps(folder / f"{name}-maps.csv", found, view)
        facts = basis(found, str(asked.data), asked.against)
        write_sheet(folder / "report.html", f"{name}: inspection of a made mirror", facts, found, main, judged, view, notes)
        if pdf:
            from mirror_studio.report.pdf import write_pdf

            write_pdf(folder / "report.html", folder / "report.pdf")
        write_json(folder / MANIFEST, {"schema": 1, "measured": str(asked.data), "against": asked.against, "align": asked.align,
                                       "versions": versions(), "files": hashes(folder)})
    progress.step(f"done: open {out / 'report.html'}")
    return content, _missed(judged, main)


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


def _check(asked: Asked) -> None:
    if asked.sigma_mm is not None and not 0.0 < asked.sigma_mm <= LARGEST_SIGMA_MM:
        raise SpecError(f"--sigma-mm {asked.sigma_mm:g}: must be above 0 and at most {LARGEST_SIGMA_MM:g} mm")
    if asked.gauge_mm is not None and not LEAST_GAUGE_MM <= asked.gauge_mm < np.inf:
        raise SpecError(f"--gauge-mm {asked.gauge_mm:g}: must be {LEAST_GAUGE_MM:g} mm or more")
    if not asked.data.is_file():
        raise SpecError(f"{asked.data}: no such file")


def _remarks(found: Inspection, main: Figures) -> list[str]:
    remarks = []
    if found.motion.reflected:
        remarks.append("the points are those of the other hand's mirror: they were reflected in x = 0 before they were laid "
                       "on the "
                       "design")
    if not found.fields.fits.any():
        remarks.append(f"a gauge of {found.fields.gauge_mm:g} mm fits nowhere on the mirror: curvature is not known; take a "
                       "shorter "
                       "one with --gauge-mm")
    elif not found.fields.known.any():
        remarks.append(f"nowhere do measured points lie close enough for a gauge of {found.fields.gauge_mm:g} mm to stand on: "
                       f"curvature is not known. The points are about {found.reconstruction.coverage.spacing_mm:.3g} mm "
                       "apart: a "
                       "gauge of eight times that tells it where they cover an area")
    if main.measured_share < SEEN_SHARE:
        remarks.append(f"{100.0 * (1.0 - main.measured_share):.0f} % of the mirror were not measured: what the driver sees in "
                       "it is "
                       "not known. There the STEP file follows the design")
    if found.fields.known.any() and main.known_share < 0.99:
        remarks.append(f"of the places where the gauge fits on the mirror {100.0 * (1.0 - main.known_share):.0f} % are not "
                       "known: "
                       "too few points lie there")
    if found.sigma_stated and found.reconstruction.sigma_factor > 1.2:
        remarks.append(f"the residuals are {found.reconstruction.sigma_factor:.2g} times what the stated sigma lets expect: "
                       "all "
                       "sigmas of the report count with the residuals")
    return remarks


def _missed(judged: Verdict | None, main: Figures) -> tuple[str, ...]:
    if judged is None or judged.outcome != "fail":
        return ()
    worst = max(("k1", "k2"), key=lambda key: abs(main.percent[key].largest or 0.0))  # type: ignore[index]
    figure = main.percent[worst]  # type: ignore[index]
    return (f"{worst}: {figure.largest:+.3g} % at ({figure.at_mm[0]:.1f}, {figure.at_mm[1]:.1f}) mm, "  # type: ignore[index]
            f"sigma {figure.sigma_at_largest:.2g} %, the limit is {judged.limit_percent:g} %",)
