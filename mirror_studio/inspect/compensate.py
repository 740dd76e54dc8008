"""Measured mirrors of one mould in, the next mould's STEP file and sheet out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirror_cad.cad_file import read_cad
from mirror_cad.errors import FileError, SpecError
from mirror_cad.laws.words import plain
from mirror_cad.made.compensation import Deviations, Forming, next_mould
from mirror_cad.made.inspection import GAUGE_MM, Align, Inspection, inspect
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_studio.build.folder import MANIFEST, new_set
from mirror_studio.build.pipeline import hashes, versions, write_json
from mirror_studio.inspect.data import read_points, read_table
from mirror_studio.inspect.pictures import correction_maps
from mirror_studio.inspect.reference import Reference, load_reference
from mirror_studio.json_types import Json, JsonObject
from mirror_studio.progress import Progress
from mirror_studio.report.text import number, templates

Array = NDArray[np.float64]

MOULD_FACE = "mould face"
MIN_MEASURED = 0.9  # of the mirror: from less no mould is made


@dataclass(frozen=True, slots=True)
class CompensationRequest:
    """What one compensation is of.

    Attributes
    ----------
    data : tuple of Path
        The measured mirrors.
    against : str
        A preset, a specification or a STEP file.
    mould : Path or None
        What they were made on.
    gain, springback, shrink_percent, offset_mm
        As `Forming` has them, the shrink in percent.
    align : str
        How the points are laid on the design.
    sigma_mm : float or None
        Of a point.
    """

    data: tuple[Path, ...]
    against: str
    mould: Path | None = None
    gain: float = 1.0
    springback: float = 1.0
    shrink_percent: float = 0.0
    offset_mm: float = 0.0
    align: Align = "best-fit"
    sigma_mm: float | None = None

    @property
    def forming(self) -> Forming:
        """How glass is formed."""
        return Forming(self.gain, self.springback, 0.01 * self.shrink_percent, self.offset_mm)


def compensate(asked: CompensationRequest, out: Path, progress: Progress) -> JsonObject:
    """Write the mould's STEP file, compensation.json and a sheet into `out`, which is replaced as a whole.

    Parameters
    ----------
    asked : CompensationRequest
        What it is of.
    out : Path
        The folder.
    progress : Progress
        Told what is being done.

    Raises
    ------
    MirrorError
        With nothing written.
    """
    _check(asked)
    progress.step(f"{asked.against}: reading the design")
    reference = load_reference(asked.against)
    mould = None if asked.mould is None else _mould(asked.mould)
    found = [_measured(path, asked, reference, progress) for path in asked.data]
    deviations = Deviations(tuple(each.reconstruction.smooth for each in found))
    new = next_mould(reference.nominal, mould, deviations, asked.forming)
    lattice = found[0].fields.lattice
    places = lattice.places
    mean, sigma = deviations.mean(places[:, 0], places[:, 1]), deviations.sigma(places[:, 0], places[:, 1])
    step = -asked.gain / asked.springback * mean
    worst = int(np.argmax(np.abs(step)))
    name = reference.name
    content: dict[str, Json] = {
        "schema": 1, "name": name, "mirrors": [str(path) for path in asked.data],
        "mould": None if mould is None else str(asked.mould), "gain": asked.gain, "springback": asked.springback,
        "shrink_percent": asked.shrink_percent, "offset_mm": asked.offset_mm,
        "deviation": {"rms_mm": float(np.sqrt(np.mean(mean**2))), "max_mm": float(mean[int(np.argmax(np.abs(mean)))]),
                      "sigma_between_mirrors_mm": None if sigma is None else float(np.sqrt(np.mean(sigma**2)))},
        "correction": {"max_mm": float(step[worst]), "max_at_mm": [float(v) for v in places[worst]],
                       "rms_mm": float(np.sqrt(np.mean(step**2)))},
        "measurement_sigma_mm": float(np.sqrt(np.mean([np.nanmean(each.fields.height_sigma**2) for each in found])
                                              / len(found)))}
    with new_set(out) as folder:
        progress.step(f"{name}: files")
        _write_mould(folder / f"{name}-mould.step", f"{name}-mould", new)
        write_json(folder / "compensation.json", content)
        _write_sheet(folder / "report.html", asked, name, content, correction_maps(found[0], mean, step, sigma))
        write_json(folder / MANIFEST, {"schema": 1, "measured": [str(path) for path in asked.data], "against": asked.against,
                                       "versions": versions(), "files": hashes(folder)})
    progress.step(f"done: open {out / 'report.html'}")
    return content


def _check(asked: CompensationRequest) -> None:
    for option, value, low, high in (("--gain", asked.gain, 0.0, 2.0), ("--springback", asked.springback, 0.0, 2.0)):
        if not low < value <= high:
            raise SpecError(f"{option} {value:g}: must be above {low:g} and at most {high:g}")
    if not -10.0 <= asked.shrink_percent <= 10.0:
        raise SpecError(f"--shrink-percent {asked.shrink_percent:g}: must be from -10 to 10")
    if not abs(asked.offset_mm) <= 100.0:
        raise SpecError(f"--offset-mm {asked.offset_mm:g}: must be from -100 to 100 mm")
    if asked.sigma_mm is not None and not 0.0 < asked.sigma_mm <= 10.0:
        raise SpecError(f"--sigma-mm {asked.sigma_mm:g}: must be above 0 and at most 10 mm")
    for path in (*asked.data, *([] if asked.mould is None else [asked.mould])):
        if not path.is_file():
            raise SpecError(f"{path}: no such file")


def _mould(path: Path) -> BSplineSurface:
    """The one face of a mould's file, as heights over (x, y)."""
    file = read_cad(path)
    faces = [face for face in file.faces if face.name == MOULD_FACE] or list(file.faces)
    if len(faces) != 1:
        raise FileError(f"{path}: the mould is one face, and the file has {len(faces)}; name it {MOULD_FACE!r}")
    surface = file.shapes(faces, splines=True)[0].surface
    if not isinstance(surface, BSplineSurface) or not surface.is_height_field:
        raise FileError(f"{path}: the mould's face is no B-spline of heights over (x, y) in mirror coordinates, as "
                        "`compensate` writes it and `build` the surface.step of a design")
    return surface


def _measured(path: Path, asked: CompensationRequest, reference: Reference, progress: Progress) -> Inspection:
    progress.step(f"{path.name}: reading")
    table = read_table(path)
    if table is not None and "z" not in table.columns:
        raise FileError(f"{path}: a mould is made from points with x, y and z")
    read = read_points(path, table, reference.nominal)
    for note in read.notes:
        progress.step(f"{path.name}: note: {note}")
    sigmas = read.sigmas if asked.sigma_mm is None else np.full(len(read.points), asked.sigma_mm)
    progress.step(f"{path.name}: {len(read.points)} points: alignment and surface")
    found = inspect(reference.nominal, read.points, sigmas, asked.align, GAUGE_MM, reference.given)
    share = float(found.fields.measured_there.mean())
    if share < MIN_MEASURED:
        raise FileError(f"{path}: {100.0 * (1.0 - share):.0f} % of the mirror were not measured: a mould would be made up "
                        "there. Measure all of it")
    return found


def _write_mould(path: Path, name: str, surface: BSplineSurface) -> None:
    from mirror_cad.occt.solid import sheet
    from mirror_cad.occt.step import OPTICAL_COLOUR, Part, write_step

    shell, face = sheet(surface, surface.domain)
    write_step(path, [Part(shell, name, OPTICAL_COLOUR, {MOULD_FACE: face})], name)


def _write_sheet(path: Path, asked: CompensationRequest, name: str, content: dict[str, Json], picture: bytes) -> None:
    from mirror_studio.inspect.sheet import png_uri

    deviation, correction = content["deviation"], content["correction"]
    assert isinstance(deviation, dict)
    assert isinstance(correction, dict)
    between = deviation["sigma_between_mirrors_mm"]
    facts = [("Mirrors", ", ".join(str(each) for each in asked.data)), ("Against", asked.against),
             ("Their mould", "as the design asks for" if asked.mould is None else str(asked.mould)),
             ("Step", f"z_mould − {plain(asked.gain)}/{plain(asked.springback)} × deviation (gain over springback)"),
             ("Glass", f"mould larger by {plain(asked.shrink_percent)} %, {plain(asked.offset_mm)} mm behind the optical face"),
             ("Deviation", f"{number(1e3 * float(deviation['rms_mm']))} µm RMS, at most "
                           f"{number(1e3 * float(deviation['max_mm']))} µm"),
             ("Correction", f"at most {number(1e3 * float(correction['max_mm']), sign=True)} µm, "
                            f"{number(1e3 * float(correction['rms_mm']))} "
              "µm RMS"),
             ("Sigma", f"{number(1e3 * float(str(content['measurement_sigma_mm'])))} µm of the measurement" + (
                 "" if between is None else f"; {number(1e3 * float(str(between)))} µm of the mean from the scatter between "
                                            "mirrors"))]
    page = templates().get_template("mould.html.j2").render(title=f"{name}: the next mould", facts=facts,
                                                            picture=png_uri(picture))
    path.write_text(page, encoding="utf-8")
