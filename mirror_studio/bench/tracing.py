"""Error and rate of tracing progressive-c by our tracer and its peers, side by side."""

from __future__ import annotations

import statistics
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from mirror_cad.design_stages import design
from mirror_cad.spec import MirrorSpec
from mirror_cad.spec.file import load_spec
from mirror_studio.bench.table import Column, Plot, Row, Table
from mirror_studio.bench.tracers import (
    alone,
    batoid_bicubic,
    mitsuba_mesh,
    occt_shape,
    ours,
    pictures,
    raw_embree,
    sphere,
    trimesh_rays,
)
from mirror_studio.bench.tracers.case import Case
from mirror_studio.bench.tracers.road import street
from mirror_studio.bench.tracers.tracer import CORES, AbsentError, Tracer, Work, few_cores, interleaved_seconds
from mirror_studio.report.text import count as count_of
from raytrace.embree import TriangleScene

MIRROR = "progressive-c"
RAYS = (1_000, 10_000, 100_000, 1_000_000)
TRIANGLES = 10_000
INCIDENCES_DEG = ((0.0, 20.0), (20.0, 40.0), (40.0, 60.0))
SPHERE_RAYS = 20_000
PICTURES_PX = ((640, 480), (1280, 720), (1920, 1080))
GROWING_RAYS = (1_000, 10_000, 100_000, 1_000_000, 10_000_000)
GROWING_SPANS = ((4, 2), (8, 4), (16, 8), (32, 16), (64, 16), (128, 16))
GROWING_TRIANGLES = (1_000, 10_000, 100_000, 1_000_000)
GROWTH_RAYS = 100_000  # where something else grows
FIRST_CALL_RAYS, FIRST_CALLS, MEMORY_RAYS = 100_000, 3, 10_000_000


def tables() -> tuple[Table, ...]:
    """Error over rate, the closed form beside it, whole pictures, growth, and what a process of its own needs."""
    case = Case(design(load_spec(MIRROR)))
    with few_cores():
        return (errors_and_rates(case), on_sphere(), whole_pictures(case), growth(case), in_a_new_process(case))


def errors_and_rates(case: Case, counts: Sequence[int] = RAYS) -> Table:
    """Every tracer on the same rays."""
    makers: list[tuple[str, Callable[[], Iterator[Tracer]]]] = [
        ("ours", partial(ours.tracers, case)), (raw_embree.FACETS, partial(raw_embree.tracers, case, TRIANGLES)),
        (trimesh_rays.TRIMESH, partial(trimesh_rays.tracers, case, TRIANGLES)),
        (mitsuba_mesh.NAME.format(mitsuba_mesh.LLVM), partial(mitsuba_mesh.tracers, case, TRIANGLES)),
        (batoid_bicubic.BICUBIC, partial(batoid_bicubic.tracers, case)), (occt_shape.ORACLE, partial(occt_shape.tracers, case))]
    found: list[Tracer] = []
    absent: list[Row] = []
    for name, make in makers:
        try:
            found += make()
        except AbsentError as reason:
            absent.append({"method": name, "note": str(reason)})
    rows = [row for count in counts for row in _side_by_side(case, found, count)]
    order = [tracer.name for tracer in found]
    rows.sort(key=lambda row: order.index(row["method"]))
    text = (f"Rays from the driver's eye to a pixel grid over {MIRROR}, row by row; arrays in and out, {CORES} cores, "
            "every method in turn in each of the rounds that the median is of. A ray is aimed at a place of the surface, so "
            "its reflection is known without tracing, from scipy's splines: the error is the angle of the reflected ray from "
            "it, the ratio that of the rates to Embree's with facet normals (in embreex, float32, whole output). Meshes have "
            f"{count_of(TRIANGLES)} triangles with vertices on the surface and its exact normals there, batoid has the exact "
            "slopes; casting the rays to what a peer takes is not timed. Leaked: rays inside the outline that found nothing. "
            "The peers give directions alone and trace the untrimmed sheet; ours cuts it and gives points and normals too.")
    columns = (Column("method", "method"), Column("rays", "rays"), Column("rate", "Mrays/s"),
               Column("ratio", "ratio to Embree, facets"), Column("error_max", "largest error, ″"),
               Column("error_rms", "error RMS, ″"), Column("leaked", "leaked share"))
    rows += absent
    return Table("tracing", "Tracing a curved mirror: error and rate", text, _with_notes(columns, rows), tuple(rows),
                 (Plot("rate", "error_max", "method", "Largest error over rate"),))


def _with_notes(columns: tuple[Column, ...], rows: Sequence[Row]) -> tuple[Column, ...]:
    """The columns, and the notes where there are any."""
    return (*columns, Column("note", "note")) if any(row.get("note") for row in rows) else columns


def _side_by_side(case: Case, tracers: Sequence[Tracer], count: int) -> list[Row]:
    rays = case.rays(count)
    chosen = [tracer for tracer in tracers if count <= tracer.most]
    works: list[Work] = []
    rows: list[Row] = []
    for tracer in chosen:
        given = rays.shuffled() if tracer.name == ours.SHUFFLED else rays
        work = tracer.prepare(given)
        largest, rms, leaked = given.errors(work())
        works.append(work)
        rows.append({"method": tracer.name, "rays": len(given.directions), "error_max": largest, "error_rms": rms,
                     "leaked": leaked, "note": tracer.note})
    times = interleaved_seconds(works)
    facets = times[:, [tracer.name for tracer in chosen].index(raw_embree.FACETS)]
    for row, own in zip(rows, times.T, strict=True):
        row |= {"rate": 1e-6 * row["rays"] / float(np.median(own)), "ratio": float(np.median(facets / own))}
    return rows


def on_sphere(count: int = SPHERE_RAYS) -> Table:
    """Ours and Embree's against the closed form, at every incidence."""
    reflector, mesh = sphere.reflector(), sphere.mesh(TRIANGLES)
    rows = []
    for least, most in INCIDENCES_DEG:
        rays = sphere.rays(count, least, most)
        for name, work in ((ours.PARAMETRIC, ours.reused(reflector, rays)),
                           (raw_embree.FACETS, raw_embree.embree(mesh, rays, interpolated=False)),
                           (raw_embree.INTERPOLATED, raw_embree.embree(mesh, rays, interpolated=True))):
            largest, rms, leaked = rays.errors(work())
            rows.append({"method": name, "incidence": f"{least:g}–{most:g}°", "rays": count, "error_max": largest,
                         "error_rms": rms, "leaked": leaked})
    rows.sort(key=lambda row: row["method"] != ours.PARAMETRIC)
    text = (f"A sphere of {sphere.RADIUS_MM:g} mm as a rational B-spline, and as {count_of(TRIANGLES)} triangles; rays to "
            "places all over it from every side. The exact reflection is the quadratic formula's, in extended precision.")
    columns = (Column("method", "method"), Column("incidence", "incidence"), Column("rays", "rays"),
               Column("error_max", "largest error, ″"), Column("error_rms", "error RMS, ″"), Column("leaked", "leaked share"))
    return Table("tracing-sphere", "A sphere against its closed form", text, columns, tuple(rows))


def whole_pictures(case: Case, sizes: Sequence[tuple[int, int]] = PICTURES_PX) -> Table:
    """The driver's view of the reference plane and of a street of triangles."""
    world = street()
    scenes = (("reference plane", pictures.reference_plane(case)), (f"street, {count_of(len(world.faces))} triangles", world))
    rows: list[Row] = []
    for label, scene in scenes:
        for size in sizes:
            frame = pictures.frame_of(*size)
            base = {"scene": label, "pixels": f"{size[0]} × {size[1]}"}
            works = [("ours", pictures.ours(case, scene, frame))]
            note = None
            for variant in (mitsuba_mesh.LLVM, mitsuba_mesh.SCALAR):  # the scalar one only where the other does not work
                try:
                    works.append((mitsuba_mesh.NAME.format(variant),
                                  pictures.mitsuba(case, scene, frame, TRIANGLES, variant)))
                    break
                except AbsentError as reason:
                    note = note or str(reason)
            else:
                rows.append(base | {"method": "Mitsuba", "note": note})
            shown = [np.asarray(work(), dtype=np.float64) for _, work in works]
            times = interleaved_seconds([work for _, work in works])
            for k, (name, _) in enumerate(works):
                rows.append(base | {
                    "method": name, "time_ms": 1e3 * float(np.median(times[:, k])),
                    "per_second": 1.0 / float(np.median(times[:, k])),
                    "ratio": float(np.median(times[:, k] / times[:, 0])),
                    "differs": float(np.abs(shown[k] - shown[0]).mean()) if k else None, "note": note if k else None})
    text = (f"The driver's view of the middle of {MIRROR}, {pictures.FRAME_WIDTH_MM:g} mm across, one ray a pixel, of the "
            "picture on the plane 8.2 m behind the eye, and of a street; every ray is reflected. Mitsuba: the mirror as "
            f"{count_of(TRIANGLES)} triangles with smooth normals and a perfect conductor, the scene as emitters, direct "
            "integrator, box filter, and the picture as the float32 array that it renders; ours is uint8. Ratio: its time over "
            "ours. The last figure is the mean difference from our picture in levels of 255: Mitsuba's ray is anywhere in its "
            "pixel, ours in the middle, and the backs of Mitsuba's emitters are black.")
    columns = (Column("method", "method"), Column("scene", "scene"), Column("pixels", "pixels"), Column("time_ms", "time, ms"),
               Column("per_second", "pictures/s"), Column("ratio", "ratio to ours"), Column("differs", "differs by, levels"))
    rows.sort(key=lambda row: row["method"] != "ours")
    return Table("tracing-pictures", "Whole pictures", text, _with_notes(columns, rows), tuple(rows))


def growth(case: Case, rays: Sequence[int] = GROWING_RAYS, spans: Sequence[tuple[int, int]] = GROWING_SPANS,
           triangles: Sequence[int] = GROWING_TRIANGLES) -> Table:
    """Rate over the number of rays, of the surface's spans, and of triangles."""
    rows = [*_growing_rays(case, rays), *_growing_spans(case.mirror.spec, spans), *_growing_triangles(case, triangles)]
    text = (f"Rate with the number of rays; with the spans of {MIRROR}'s surface (fitted anew in degree 5) and with the "
            f"triangles of a mesh of it in raytrace.embree, each for {count_of(GROWTH_RAYS)} rays. Leaked: rays inside the "
            "outline that our tracer did not find.")
    columns = (Column("series", "what grows"), Column("size", "size"), Column("time_ms", "time, ms"), Column("rate", "Mrays/s"),
               Column("leaked", "leaked rays"))
    return Table("tracing-growth", "Rate over size", text, columns, tuple(rows),
                 (Plot("size", "rate", "series", "Rate over size"),))


def _growing_rays(case: Case, counts: Sequence[int]) -> Iterator[Row]:
    for count in counts:
        rays = case.rays(count)
        work = ours.reused(case.reflector, rays)
        leaked = int(np.count_nonzero(np.isnan(work()[rays.inside, 0])))
        yield _row("rays, ours", len(rays.directions), len(rays.directions), work) | {"leaked": leaked}
    mesh = case.mesh(TRIANGLES)
    for count in counts:
        if count <= RAYS[-1]:
            rays = case.rays(count)
            work = raw_embree.embree(mesh, rays, interpolated=False)
            yield _row("rays, Embree, facets", len(rays.directions), len(rays.directions), work)


def _growing_spans(spec: MirrorSpec, spans: Sequence[tuple[int, int]]) -> Iterator[Row]:
    for wanted in spans:
        cut = spec.model_copy(update={"surface": spec.surface.model_copy(update={"degree": 5, "spans": wanted})})
        case = Case(design(cut))
        rays = case.rays(GROWTH_RAYS)
        work = ours.reused(case.reflector, rays)
        leaked = int(np.count_nonzero(np.isnan(work()[rays.inside, 0])))
        yield _row("spans, ours", wanted[0] * wanted[1], len(rays.directions), work) | {"leaked": leaked}


def _growing_triangles(case: Case, triangles: Sequence[int]) -> Iterator[Row]:
    rays = case.rays(GROWTH_RAYS)
    for count in triangles:
        mesh = case.mesh(count)
        scene = TriangleScene(mesh.vertices, mesh.faces)
        work = partial(scene.first_hits, rays.origins, rays.directions)
        work()
        yield _row("triangles, raytrace.embree", len(mesh.faces), len(rays.directions), work)


def _row(series: str, size: int, rays: int, work: Callable[[], Any]) -> Row:
    seconds = float(np.median(interleaved_seconds([work])))
    return {"series": series, "size": size, "time_ms": 1e3 * seconds, "rate": 1e-6 * rays / seconds}


def in_a_new_process(case: Case, first_calls: int = FIRST_CALLS, memory_rays: int = MEMORY_RAYS) -> Table:
    """What comes before the first picture, and what a trace takes beside its arrays."""
    with tempfile.TemporaryDirectory(prefix="mirror-cad-") as folder:
        path = Path(folder) / "mirror.step"
        case.mirror.export_step(path)
        alone.measured("first", path, FIRST_CALL_RAYS)  # fills numba's cache
        calls = [alone.measured("first", path, FIRST_CALL_RAYS) for _ in range(first_calls)]
        peaks = {mode: alone.measured(mode, path, memory_rays)["peak_mb"] for mode in ("reflect", "fill")}
    figures = [(title, 1e3 * statistics.median(call[key] for call in calls), "ms") for key, title in (
        ("import_s", "import numpy, raytrace and its kernels"), ("load_s", "load_reflector() of the STEP file"),
        ("first_s", f"first reflect(), {count_of(FIRST_CALL_RAYS)} rays"), ("second_s", "the one after it"))]
    figures.append((f"memory of reflect() beside its arrays, {count_of(memory_rays)} rays",
                    peaks["reflect"] - peaks["fill"], "MB"))
    text = (f"{MIRROR} from its STEP file in a process of its own: median of {first_calls}, numba's cache filled. Memory: the "
            "peak with the trace less the peak of a process that fills the same arrays and does not trace.")
    return Table("tracing-process", "What a new process needs", text,
                 (Column("what", "what"), Column("value", "value"), Column("unit", "unit")),
                 tuple({"what": what, "value": value, "unit": unit} for what, value, unit in figures))
