"""The files of one mirror: designed, exported, read back, checked, traced and reported."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mirror_cad.design_stages import design
from mirror_cad.deviation import Deviation
from mirror_cad.errors import WriteError
from mirror_cad.mesh import SurfaceMesh
from mirror_cad.mirror import Mirror
from mirror_cad.outline.files import write_dxf
from mirror_cad.own_files import hand_of
from mirror_cad.plate_files import PlateFiles
from mirror_cad.reflection import reflected_mesh, reflected_points, reflected_surface
from mirror_cad.spec import MirrorSpec
from mirror_cad.spec.file import spec_as_json
from mirror_cad.stl_file import read_stl
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_studio.as_json import deviation_as_json, manifest_as_json, metrics_as_json, trace_metrics_as_json
from mirror_studio.build import checks
from mirror_studio.build.folder import MANIFEST, new_set
from mirror_studio.build.methods import compare_methods
from mirror_studio.build.results import (
    Built,
    FieldOfView,
    FileChecks,
    GlassFigures,
    LaneFigures,
    Manifest,
    Metrics,
    OnPlane,
    PlateFigures,
    TraceMetrics,
)
from mirror_studio.build.wanted import target_figures
from mirror_studio.compiling import wait_for_compiled
from mirror_studio.json_types import Json, JsonObject
from mirror_studio.progress import Progress
from mirror_studio.rules.of_spec import rule_of_spec, surface_lines
from mirror_studio.viewing_setup import ViewingSetup
from raytrace.assembly import FRONT_FACE, OPTICAL_FACE
from raytrace.cad_reflector import plate_reflector
from raytrace.errors import TraceError
from raytrace.image import photograph
from raytrace.load import Colour, load_reflector
from raytrace.measures.difference import reflected_difference
from raytrace.measures.edge_rays import h_fov_between_edges
from raytrace.measures.field_of_view import traced_fields_of_view
from raytrace.measures.ghost import ghost
from raytrace.measures.lane import lane_straightness
from raytrace.measures.lane_image import lane_straightness_in_picture
from raytrace.measures.registry import measures_of
from raytrace.placement import Placement
from raytrace.rays import Status
from raytrace.reflector import OBSTACLE_DEFLECTION_MM, Reflector
from raytrace.scene.reference import Picture, load_picture
from raytrace.seating import Place
from raytrace.surfaces.base import GlassPlate
from raytrace.surfaces.mesh import Normals
from raytrace.viewing.camera import Frame
from raytrace.viewing.view import box_of

Array = NDArray[np.float64]

SMALLEST_BOX_MM = 1e-3  # a reflector seen edge-on, or a closed face without edges, has no frame to be drawn in
PACKAGES = ("mirror-cad", "cadquery-ocp", "build123d", "cadquery", "numpy", "scipy", "numba", "embreex", "vtk", "pyvista")


def build(spec: MirrorSpec, out: Path, progress: Progress, pdf: bool = False) -> Built:
    """Make the files of one mirror in `out`, which is replaced as a whole. Raises: MirrorError, with nothing written."""
    with new_set(out) as folder:
        built = build_into(folder, spec, progress, pdf)
    progress.step(f"{spec.name}: done, in {out}")
    return built


def build_into(folder: Path, spec: MirrorSpec, progress: Progress, pdf: bool = False) -> Built:
    """Make the files of one mirror in an existing empty folder; the report as PDF too where asked for."""
    name = spec.name
    picture = load_picture(spec.scene.image)
    rule_of_spec(spec)  # which refuses one that there is not
    progress.step(f"{name}: designing")
    mirror = design(spec)
    for note in mirror.notes:
        progress.step(f"{name}: note: {note}")
    progress.step(f"{name}: writing and reading back STEP, STL, points and outline")
    plate, files = _write_and_check(folder, mirror)
    stl, optical = folder / f"{name}.stl", plate.step.named(OPTICAL_FACE)
    read_back, facets_back = optical.surface, read_stl(stl)
    if mirror.as_made.reflected:  # and back, into the frame of the design
        read_back, facets_back = reflected_surface(read_back), reflected_mesh(facets_back)
    progress.step(f"{name}: curvature deviation")
    deviation = mirror.deviation(read_back, facets_back)
    wait_for_compiled(progress)
    progress.step(f"{name}: tracing the driver's view")
    fronts = [face.shape for face in plate.step.faces if face.name == FRONT_FACE]
    reflector = plate_reflector(optical.shape, fronts, plate.step.sides, spec.glass.index).moved(
        Placement.identity("file", spec.part.hand))
    view = _drivers_view(mirror, reflector, picture, progress)
    with ThreadPoolExecutor(1) as writer:  # PNG is made while figures are: zlib needs no interpreter
        written = writer.submit(write_png, folder / "driver-view.png", view.picture)
        if spec.has_laws:
            progress.step(f"{name}: decoupled and faithful surface side by side")
        metrics = _measured(mirror, deviation, reflector, view, plate, files, stl)
        written.result()
    progress.step(f"{name}: report")
    _report(folder, mirror, deviation, metrics, (plate.area_mm2, optical.area_mm2), read_back, reflector, view.picture, pdf)
    from mirror_studio.missed import missed_in_words
    from mirror_studio.report.verdict_table import requirements

    return Built(mirror, deviation, metrics, missed_in_words(requirements(mirror, deviation, metrics)))


# --- the stages of a build ----------------------------------------------------------------------------------------


class _DriversView(NamedTuple):
    """The picture, its frame, and how many rays had which status."""

    picture: Picture
    frame: Frame
    rays: Mapping[str, int]


def _write_and_check(folder: Path, mirror: Mirror) -> tuple[PlateFiles, FileChecks]:
    """Write the files of the part; returns the STEP files as read back, and how far each file is from the design.

    The process with the CAD kernel writes and reads STEP while this one writes the rest.
    """
    name, made, points = mirror.spec.name, mirror.as_made, mirror.grid_points()
    written = reflected_points(points) if made.reflected else points
    step, sheet, table, outline = (folder / each for each in (
        f"{name}.step", f"{name}-surface.step", f"{name}-points.csv", "outline.dxf"))
    failed: list[Exception] = []

    def write_the_rest() -> None:
        try:
            mirror.export_stl_apart(folder / f"{name}.stl")
            write_points(table, written)
            write_dxf(made.outline, outline, made.transition)
        except Exception as error:  # told after what the kernel has to say of the plate
            failed.append(error)

    plate = mirror.export_steps_apart(step, sheet, OBSTACLE_DEFLECTION_MM, write_the_rest)
    if failed:
        raise failed[0]
    return plate, FileChecks(
        checks.check_step(step, plate.step, made, plate.volume_mm3), checks.check_surface_step(sheet, plate.sheet, made),
        checks.check_outline(outline, made), checks.check_points(table, written))


def _drivers_view(mirror: Mirror, reflector: Reflector, picture: Picture, progress: Progress) -> _DriversView:
    setup, frame = ViewingSetup.of(mirror.spec, mirror.box), Frame.around(mirror.box, mirror.spec.view.width_px)
    seen, rays = photograph(reflector, frame.camera(setup.eye), setup.scene(picture, mirror.spec), progress.share)
    return _DriversView(seen, frame, rays)


def _measured(mirror: Mirror, deviation: Deviation, reflector: Reflector, view: _DriversView, written: PlateFiles,
              files: FileChecks, stl: Path) -> Metrics:
    from mirror_studio.report.verdict_table import view_requirements

    setup = ViewingSetup.of(mirror.spec, mirror.box)
    use = setup.in_use(reflector, mirror)
    figures = {name: one.value(use) for name, one in measures_of(use, "setup").items()}
    mesh = _facets(stl, mirror)
    facets, smooth = (reflected_difference(each, reflector.uncoated, setup.eye, setup.plane_z_mm, mirror.box)
                      for each in (mesh, mesh.interpolated))
    eye = setup.eye
    metrics = Metrics(
        h_fov_deg=FieldOfView(figures["h_fov_section_deg"], figures["h_fov_traced_deg"]),
        v_fov_left_deg=FieldOfView(figures["v_fov_left_section_deg"], figures["v_fov_left_traced_deg"]),
        lane_straightness_percent=LaneFigures(
            figures["lane_straightness_percent"],
            lane_straightness_in_picture(view.picture, view.frame, reflector.uncoated, eye, mirror.box)),
        stl_on_plane=OnPlane(facets.plane_max_mm, facets.plane_rms_mm, facets.rays),
        stl_interpolated_on_plane=OnPlane(smooth.plane_max_mm, smooth.plane_rms_mm, smooth.rays),
        measures=figures, explained=deviation.explained, ray_deviation=deviation.rays,
        methods=compare_methods(mirror) if mirror.spec.has_laws else None,
        rays=view.rays, eye_mm=(float(eye[0]), float(eye[1]), float(eye[2])),
        plate=PlateFigures(written.area_mm2, written.volume_mm3, mirror.as_made.back_error_mm), files=files,
        glass=_glass(mirror, reflector.glass, eye, figures["h_fov_traced_deg"])
        if mirror.spec.glass.reflecting == "back" else None,
        target=target_figures(mirror, reflector.uncoated.surface),
        rules=surface_lines(mirror.spec, reflector))
    return replace(metrics, limits=tuple(view_requirements(mirror, metrics)))


def _report(folder: Path, mirror: Mirror, deviation: Deviation, metrics: Metrics, areas_mm2: tuple[float, float],
            read_back: BSplineSurface, reflector: Reflector, view: Picture, pdf: bool) -> None:
    """Write the figures as JSON and tables, the report and the manifest, which names every other file."""
    from mirror_studio.report.page import write_report
    from mirror_studio.report.pdf import write_pdf
    from mirror_studio.report.report_data import find, write_findings

    write_json(folder / "metrics.json", metrics_as_json(metrics))
    write_json(folder / "deviation.json", deviation_as_json(deviation, metrics.target))
    manifest = Manifest(spec_as_json(mirror.spec), versions(), mirror.notes)
    findings = find(mirror, deviation, read_back, metrics, areas_mm2, reflector.surface)
    write_findings(folder, mirror, deviation, findings, manifest)
    manifest = replace(manifest, files=hashes(folder))
    write_report(folder / "report.html", mirror, deviation, metrics, manifest, view, findings)
    if pdf:
        write_pdf(folder / "report.html", folder / "report.pdf")
    write_json(folder / MANIFEST, manifest_as_json(mirror, replace(manifest, files=hashes(folder))))


# --- a file of any origin -----------------------------------------------------------------------------------------


def trace_file(path: Path, spec: MirrorSpec, out: Path, progress: Progress, face: str | int | Colour | None = None,
               normals: Normals = "facets", place: Place = "auto") -> TraceMetrics:
    """Trace a CAD or mesh file with the spec's eye, scene and view.

    face, normals, place : as for `load_reflector`. A STEP file with a front face before its optical face is traced through
    glass of the spec's index.

    Raises: MirrorError as the readers do, and where no ray is reflected, with nothing written.
    """
    picture = load_picture(spec.scene.image)
    progress.step(f"{path.name}: reading")
    reflector = load_reflector(path, face, normals, spec.glass.index, progress.share, place)
    placement = stated_placement(path.name, reflector, progress)
    hand = hand_of(path)
    if hand is not None and "hand" in spec.part.model_fields_set and hand != spec.part.hand:
        progress.step(f"{path.name}: note: the file has a {hand}-hand mirror, {spec.name} states part.hand = "
                      f"\"{spec.part.hand}\": the file's hand is taken")
    box = box_of(reflector)
    _refuse_edge_on(box)
    setup = ViewingSetup.of(spec, box)
    eye, use = setup.eye, setup.in_use(reflector)
    scene = setup.scene(picture, spec)
    frame = Frame.around(box, spec.view.width_px)
    with new_set(out) as folder:
        wait_for_compiled(progress)
        progress.step(f"{path.name}: tracing the driver's view")
        view, rays = photograph(reflector, frame.camera(eye), scene, progress.share)
        refuse_unreflected(path.name, rays, placement)
        write_png(folder / "driver-view.png", view)
        h_fov = h_fov_between_edges(reflector, eye, box)
        metrics = TraceMetrics(
            None if h_fov is None else math.degrees(h_fov),
            LaneFigures(lane_straightness(use.setup, use.lane).percent,
                        lane_straightness_in_picture(view, frame, reflector.uncoated, eye, box)),
            rays, reflector.surface.normals_from, (float(eye[0]), float(eye[1]), float(eye[2])), box, placement)
        write_json(folder / "metrics.json", trace_metrics_as_json(metrics))
        manifest: JsonObject = {"schema": 1, "traced": path.name, "sha256": _sha256(path), "spec": _lent(spec, reflector),
                    "versions": versions(), "files": hashes(folder)}
        write_json(folder / MANIFEST, manifest)
    progress.step(f"{path.name}: done, in {out}")
    return metrics


def _lent(spec: MirrorSpec, reflector: Reflector) -> JsonObject:
    """What of a specification a trace uses: how the file is looked at, and the glass where there is some."""
    content = spec_as_json(spec)
    lent: dict[str, Json] = {section: content[section] for section in ("eye", "scene", "view")}
    return lent if not reflector.surface.refracts else lent | {"glass": {"index": spec.glass.index}}


def stated_placement(name: str, reflector: Reflector, progress: Progress) -> Placement:
    """Say where a mirror is in its file; returns it."""
    placement = reflector.placement or Placement.identity("file")
    progress.step(f"{name}: placement: {placement}")
    return placement


def refuse_unreflected(name: str, rays: Mapping[str, int], placement: Placement) -> None:
    """Raise TraceError where an eye sees nothing in the mirror: a picture of it would be empty."""
    if not rays.get(Status.REFLECTED.name.lower()):
        found = ", ".join(f"{count} {status}" for status, count in rays.items()) or "none was traced"
        raise TraceError(f"{name}: no ray from the eye is reflected ({found}); the mirror was taken to be at {placement}. "
                         "State with --place where it is and which way it looks, or choose what reflects with --face")


# --- glass --------------------------------------------------------------------------------------------------------


def _facets(stl: Path, mirror: Mirror) -> Reflector:
    """The STL as a reflector; where the back reflects, without the front that would hide it, and without the sides."""
    if mirror.spec.glass.reflecting == "front":
        return load_reflector(stl, place="auto")  # in the frame of the design, whichever hand the file has
    mesh, domain = read_stl(stl), mirror.surface.domain
    if mirror.as_made.reflected:
        mesh = reflected_mesh(mesh)
    x, y = np.clip(mesh.vertices[:, 0], *domain[:2]), np.clip(mesh.vertices[:, 1], *domain[2:])
    on_back = np.linalg.norm(mirror.surface.evaluate(x, y) - mesh.vertices, axis=1) < 0.5 * mirror.spec.glass.thickness_mm
    return Reflector.of_mesh(SurfaceMesh(mesh.vertices, mesh.faces[on_back[mesh.faces].all(axis=1)]))


def _glass(mirror: Mirror, plate: GlassPlate, eye: Array, h_fov: float | None) -> GlassFigures:
    """What the glass does to the driver's view: ghost over a grid of points, light, and field of view against none."""
    bare, _ = traced_fields_of_view(plate.uncoated(), eye, mirror.box, mirror.left_height_mm)
    points = mirror.grid_points()
    return GlassFigures(mirror.spec.glass.reflecting, plate.index, ghost(plate.untrimmed(), eye, points[:, 0], points[:, 1]),
                        None if h_fov is None else h_fov - math.degrees(bare))


# --- what is taken from any reflector ------------------------------------------------------------------------


def _refuse_edge_on(box: tuple[float, float, float, float]) -> None:
    """Raises: TraceError for what reflects in a box (x_min, x_max, y_min, y_max) that a driver sees nothing in."""
    x_min, x_max, y_min, y_max = box
    if x_max - x_min < SMALLEST_BOX_MM or y_max - y_min < SMALLEST_BOX_MM:
        raise TraceError(f"what reflects is {x_max - x_min:.3g} × {y_max - y_min:.3g} mm across as the driver looks at it: it "
                         "is seen edge-on, or has no edges. State with --place where it is, or choose its face with --face")


# --- files ------------------------------------------------------------------------------------------------------------


def versions() -> dict[str, str]:
    """Versions of the packages that made a set."""
    found = {}
    for package in PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return found


def write_points(path: Path, points: Array) -> None:
    """x, y, z in mm and the unit normal, one row a point."""
    with path.open("w", encoding="utf-8") as stream:
        stream.write("x_mm,y_mm,z_mm,nx,ny,nz\n")
        np.savetxt(stream, points, fmt="%.12g", delimiter=",")


def write_png(path: Path, picture: Picture) -> None:
    """Write a picture as PNG. Raises: WriteError where it reads back different."""
    from PIL import Image

    Image.fromarray(picture).save(path, format="PNG", compress_level=4)
    with Image.open(path) as read:
        if read.size != picture.shape[1::-1] or read.tobytes() != picture.tobytes():
            raise WriteError(f"{path.name}: the picture reads back different from what was written")


def write_json(path: Path, content: JsonObject) -> None:
    """Write JSON without NaN. Raises: WriteError where a figure is not finite or the file reads back different."""
    try:
        text = json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False)
    except ValueError:
        raise WriteError(f"{path.name}: a figure is not finite") from None
    path.write_text(text + "\n", encoding="utf-8")
    if json.loads(path.read_text("utf-8")) != json.loads(text):
        raise WriteError(f"{path.name}: reads back different from what was written")


def hashes(folder: Path) -> dict[str, str]:
    """SHA-256 of every file below a folder, by its path in it."""
    return {str(path.relative_to(folder)): _sha256(path) for path in sorted(folder.rglob("*")) if path.is_file()}


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()

