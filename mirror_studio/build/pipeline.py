"""A specification in, the files of one mirror out: designed, exported, read back, checked, traced and reported."""

from __future__ import annotations

import hashlib
import io
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirror_cad.deviation import CurvatureDeviation
from mirror_cad.errors import WriteError
from mirror_cad.mesh import SurfaceMesh
from mirror_cad.mirror import Mirror, design
from mirror_cad.outline.files import write_dxf
from mirror_cad.own_files import hand_of
from mirror_cad.reflection import reflected_mesh, reflected_points, reflected_surface
from mirror_cad.spec import MirrorSpec
from mirror_cad.spec.file import spec_as_json
from mirror_studio.build.folder import MANIFEST, new_set
from mirror_studio.build.methods import compare_methods, floor_of
from mirror_studio.progress import Progress
from mirror_studio.viewing_setup import ViewingSetup
from raytrace.errors import TraceError
from raytrace.image import photograph
from raytrace.load import Colour, load_reflector, reflector_of
from raytrace.measures.difference import reflected_difference
from raytrace.measures.edge_rays import h_fov_between_edges
from raytrace.measures.field_of_view import traced_fields_of_view
from raytrace.measures.ghost import ghost
from raytrace.measures.lane import lane_straightness
from raytrace.measures.lane_image import lane_straightness_in_picture
from raytrace.measures.registry import measures_of
from raytrace.placement import Placement, moved
from raytrace.rays import Status
from raytrace.reflector import Reflector
from raytrace.scene.reference import Picture, load_picture
from raytrace.seating import Place
from raytrace.surfaces.mesh import Normals
from raytrace.surfaces.plate import Plate
from raytrace.viewing.camera import Frame

Array = NDArray[np.float64]

SMALLEST_BOX_MM = 1e-3  # a reflector seen edge-on, or a closed face without edges, has no frame to be drawn in
PACKAGES = ("mirror-cad", "cadquery-ocp", "build123d", "cadquery", "numpy", "scipy", "numba", "embreex", "vtk", "pyvista")


@dataclass(frozen=True, eq=False)
class Built:
    """What a build leaves in memory: the mirror, its deviation, the metrics and whether everything asked for is met."""

    mirror: Mirror
    deviation: CurvatureDeviation
    metrics: dict[str, Any]
    missed: tuple[str, ...]


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
    # What brings the kernel: a trace, whose file a child process reads, does without.
    from mirror_cad.occt.tessellate import read_stl
    from mirror_studio.build import checks

    progress.step(f"{name}: designing")
    mirror = design(spec)
    for note in mirror.notes:
        progress.step(f"{name}: note: {note}")
    setting = ViewingSetup.of(spec, mirror.box)
    eye = setting.eye
    step, stl = folder / f"{name}.step", folder / f"{name}.stl"
    progress.step(f"{name}: writing and reading back STEP, STL, points and outline")
    made, points = mirror.as_made, mirror.grid_points()  # what the files hold; the figures are those of the design
    mirror.export_step(step)
    mirror.export_surface_step(folder / f"{name}-surface.step")
    mirror.export_stl(stl)
    written = reflected_points(points) if made.reflected else points
    write_points(folder / f"{name}-points.csv", written)
    write_dxf(made.outline, folder / "outline.dxf")
    step_file, files = checks.check_step(step, made)
    read_back, facets_back = step_file.optical_surface(), read_stl(stl)
    files |= checks.check_surface_step(folder / f"{name}-surface.step", made)
    files |= checks.check_outline(folder / "outline.dxf", made)
    files |= checks.check_points(folder / f"{name}-points.csv", written)
    if made.reflected:  # and back, into the frame of the design
        read_back, facets_back = reflected_surface(read_back), reflected_mesh(facets_back)

    progress.step(f"{name}: curvature deviation")
    deviation = mirror.deviation(read_back, facets_back)
    progress.step(f"{name}: tracing the driver's view")
    scene = setting.scene(picture, spec)
    frame = Frame.around(mirror.box, spec.view.width_px)
    reflector = moved(reflector_of(step_file, spec.glass.index), Placement.identity("file", spec.part.hand))
    view, rays = photograph(reflector, frame.camera(eye), scene, progress.share)
    view_png = write_png(folder / "driver-view.png", view)
    use = setting.in_use(reflector, mirror)
    figures = {name: one.value(use) for name, one in measures_of(use, "setup").items()}
    progress.step(f"{name}: decoupled and faithful surface side by side")
    methods = compare_methods(mirror)
    mesh = _facets(stl, mirror)
    facets, smooth = (reflected_difference(each, reflector.uncoated, eye, scene.z_mm, mirror.box)
                      for each in (mesh, mesh.interpolated))
    metrics = {
        "h_fov_deg": {"section": figures["h_fov_section_deg"], "traced": figures["h_fov_traced_deg"]},
        "v_fov_left_deg": {"section": figures["v_fov_left_section_deg"], "traced": figures["v_fov_left_traced_deg"]},
        "lane_straightness_percent": {
            "traced": figures["lane_straightness_percent"],
            "image": lane_straightness_in_picture(view, frame, reflector.uncoated, eye, mirror.box)},
        "stl_on_plane_mm": {"max": facets.plane_max_mm, "rms": facets.plane_rms_mm, "rays": facets.rays},
        "stl_interpolated_on_plane_mm": {"max": smooth.plane_max_mm, "rms": smooth.plane_rms_mm, "rays": smooth.rays},
        "measures": figures,
        "error_budget": {"explained": deviation.explained, "chain_arcmin": deviation.chain},
        "methods": methods,
        "rays": rays,
        "eye_mm": [float(value) for value in eye],
        "plate": {"area_mm2": made.plate.area_mm2, "volume_mm3": made.plate.volume_mm3,
                  "back_error_mm": made.plate.back_error_mm},
        "files": files,
    }
    if spec.glass.reflecting == "back":
        metrics["glass"] = _glass(mirror, reflector.plate, eye, points, figures["h_fov_traced_deg"])
    from mirror_studio.missed import missed_in_words
    from mirror_studio.report import find, write_findings, write_pdf, write_report
    from mirror_studio.report.verdict_table import as_json, requirements, view_requirements

    asked = view_requirements(mirror, metrics)
    if asked:
        metrics["limits"] = as_json(asked)
    progress.step(f"{name}: report")
    write_json(folder / "metrics.json", metrics)
    write_json(folder / "deviation.json", deviation.as_json())
    manifest = _manifest(mirror)
    findings = find(mirror, deviation, read_back, metrics, step_file, reflector.surface)
    write_findings(folder, mirror, deviation, findings, manifest)
    manifest["files"] = hashes(folder)
    write_report(folder / "report.html", mirror, deviation, metrics, manifest, view_png, findings)
    if pdf:
        write_pdf(folder / "report.html", folder / "report.pdf")
    manifest["files"] = hashes(folder)
    write_json(folder / MANIFEST, manifest)
    return Built(mirror, deviation, metrics, missed_in_words(requirements(mirror, deviation, metrics)))


def trace_file(path: Path, spec: MirrorSpec, out: Path, progress: Progress, face: str | int | Colour | None = None,
               normals: Normals = "facets", place: Place = "auto") -> dict[str, Any]:
    """Trace a CAD or mesh file with the spec's eye, scene and view; returns what metrics.json holds.

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
    box = _front_box(reflector)
    setting = ViewingSetup.of(spec, box)
    eye, use = setting.eye, setting.in_use(reflector)
    scene = setting.scene(picture, spec)
    frame = Frame.around(box, spec.view.width_px)
    with new_set(out) as folder:
        progress.step(f"{path.name}: tracing the driver's view")
        view, rays = photograph(reflector, frame.camera(eye), scene, progress.share)
        refuse_unreflected(path.name, rays, placement)
        write_png(folder / "driver-view.png", view)
        h_fov = h_fov_between_edges(reflector, eye, box)
        metrics: dict[str, Any] = {
            "h_fov_deg": {"traced": None if h_fov is None else math.degrees(h_fov)},
            "lane_straightness_percent": {
                "traced": lane_straightness(use.setup, use.lane).percent,
                "image": lane_straightness_in_picture(view, frame, reflector.uncoated, eye, box)},
            "rays": rays, "normals_from": reflector.surface.normals_from,
            "eye_mm": [float(value) for value in eye], "box_mm": list(box), "placement": placement.as_json()}
        write_json(folder / "metrics.json", metrics)
        manifest = {"schema": 1, "traced": path.name, "sha256": _sha256(path), "spec": _lent(spec, reflector),
                    "versions": versions(), "files": hashes(folder)}
        write_json(folder / MANIFEST, manifest)
    progress.step(f"{path.name}: done, in {out}")
    return metrics


def _lent(spec: MirrorSpec, reflector: Reflector) -> dict[str, Any]:
    """What of a specification a trace uses: how the file is looked at, and the glass where there is some."""
    content = spec_as_json(spec)
    lent = {section: content[section] for section in ("eye", "scene", "view")}
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
    from mirror_cad.occt.tessellate import read_stl

    mesh, domain = read_stl(stl), mirror.surface.domain
    if mirror.as_made.reflected:
        mesh = reflected_mesh(mesh)
    x, y = np.clip(mesh.vertices[:, 0], *domain[:2]), np.clip(mesh.vertices[:, 1], *domain[2:])
    on_back = np.linalg.norm(mirror.surface.evaluate(x, y) - mesh.vertices, axis=1) < 0.5 * mirror.spec.glass.thickness_mm
    return Reflector.of_mesh(SurfaceMesh(mesh.vertices, mesh.faces[on_back[mesh.faces].all(axis=1)]))


def _glass(mirror: Mirror, plate: Plate, eye: Array, points: Array, h_fov: float | None) -> dict[str, Any]:
    """What the glass does to the driver's view: ghost over the grid of points, light, and field of view against none."""
    bare, _ = traced_fields_of_view(plate.uncoated(), eye, mirror.box, mirror.left_height_mm)
    seen = ghost(plate.untrimmed(), eye, points[:, 0], points[:, 1])
    return {"reflecting": mirror.spec.glass.reflecting, "index": plate.index,
            "ghost_arcmin": {"max": seen.max_arcmin, "max_at_mm": seen.max_at_mm and list(seen.max_at_mm),
                             "mean": seen.mean_arcmin, "rays": seen.rays},
            "front_reflectance": {"mean": seen.front_mean, "max": seen.front_max},
            "image_reflectance": {"mean": seen.image_mean},
            "h_fov_added_deg": None if h_fov is None else h_fov - math.degrees(bare)}


# --- what is taken from any reflector ------------------------------------------------------------------------


def _front_box(reflector: Reflector) -> tuple[float, float, float, float]:
    """(x_min, x_max, y_min, y_max) of what reflects."""
    points = reflector.outline()
    (x_min, y_min, _), (x_max, y_max, _) = points.min(axis=0), points.max(axis=0)
    if x_max - x_min < SMALLEST_BOX_MM or y_max - y_min < SMALLEST_BOX_MM:
        raise TraceError(f"what reflects is {x_max - x_min:.3g} × {y_max - y_min:.3g} mm across as the driver looks at it: it "
                         "is seen edge-on, or has no edges. State with --place where it is, or choose its face with --face")
    return float(x_min), float(x_max), float(y_min), float(y_max)


# --- files ------------------------------------------------------------------------------------------------------------


def _manifest(mirror: Mirror) -> dict[str, Any]:
    from mirror_studio.build.checks import SAME_MM

    spec, fit = mirror.spec, mirror.fit
    return {
        "schema": 1,
        "spec": spec_as_json(spec),
        "versions": versions(),
        "tolerances": {"position_mm": spec.surface.position_tolerance_mm,
                       "curvature_percent": spec.surface.curvature_tolerance_percent,
                       "stl_deflection_mm": spec.export.stl_deflection_mm, "back_mm": 1e-3, "read_back_mm": SAME_MM},
        "fit": {"route": fit.route, "degree": fit.degree, "spans": list(fit.spans),
                "position_error_mm": fit.position_error_mm, "curvature_error_percent": fit.curvature_error_percent,
                "worst_at_mm": list(fit.worst_at_mm), "met": fit.met},
        "faithful": floor_of(mirror.faithful),
        "matched": {mirror.matched[0]: mirror.matched[1]} if mirror.matched else None,
        "notes": list(mirror.notes),
    }


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


def write_png(path: Path, picture: Picture) -> bytes:
    """Write a picture as PNG; returns the bytes written. Raises: WriteError where they decode differently."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, format="PNG", compress_level=4)
    path.write_bytes(buffer.getvalue())
    with Image.open(path) as read:
        if not np.array_equal(np.asarray(read), picture):
            raise WriteError(f"{path.name}: the picture reads back different from what was written")
    return buffer.getvalue()


def write_json(path: Path, content: dict[str, Any]) -> None:
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

