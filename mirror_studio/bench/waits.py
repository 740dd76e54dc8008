"""How long people wait: whole commands beside the import of their libraries, kernels beside the peers with the same rays.

Processes are told by their processor time, which a busy machine changes little; kernels by the clock, in turn with their peers,
so that their ratios hold where the seconds do not. A loop before and after tells what machine it was.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirror_cad.design_stages import design
from mirror_cad.occt.peers import perforated_plate_step, tiled_sheet_step
from mirror_cad.spec.file import load_spec
from mirror_studio.bench.table import Column, Row, Table
from mirror_studio.bench.tracers import mitsuba_mesh, ours, pictures, raw_embree
from mirror_studio.bench.tracers.case import Case, Rays
from mirror_studio.bench.tracers.road import street
from mirror_studio.bench.tracers.tracer import AbsentError, Work, few_cores, interleaved_seconds
from mirror_studio.progress import Progress
from raytrace.rays import Trace
from raytrace.reflector import Reflector
from raytrace.trace import reflect

MIRROR = "progressive-c"
TRIANGLES = 10_000
MANY_RAYS, FEW_RAYS, GLASS_RAYS = 1_000_000, 1_000, 200_000
TILES, TILE_POLES = 32, 16  # each way, of a sheet in untrimmed faces: a file of 35 MB
HOLES = 31  # each way, through a plate: with its six sides 967 faces, all but these curved
CALLS = 100  # of what is told by the call: one alone, after the rest between two works, finds no cache warm
ROUNDS = 3
BARE = "from OCP.STEPControl import STEPControl_Reader; import numba, scipy.interpolate, PIL.Image"
BARE_NAME = "import of the kernel's STEP reader, numba, scipy.interpolate and Pillow"
LOOP = 3_000_000


def tables(progress: Progress | None) -> tuple[Table, ...]:
    """The waits, and the calibration."""
    said = progress or Progress()
    loops = [("before", *_loop())]
    rows: list[Row] = []
    with few_cores():
        said.step("waits: kernels beside their peers")
        rows += _kernels(Case(design(load_spec(MIRROR))))
        said.step("waits: a design with all its measures")
        rows.append(evaluation())
        rows += _processes(said)
    loops.append(("after", *_loop()))
    columns = (Column("work", "work"), Column("ours", "ours"), Column("unit", "unit"), Column("peer", "peer"),
               Column("theirs", "the peer's"), Column("ratio", "ratio"), Column("asked", "asked"), Column("note", "note"))
    text = ("By the clock, but where a line says otherwise, on a machine at rest. Processes: whole, warm but where said; "
            f"medians of {ROUNDS} rounds in which every command runs once; the ratio is ours over the peer's; the processor "
            "time is that of the process and of what it starts. Kernels: every method in turn in each round; the ratio is our "
            "rate over the peer's. The studio's lines are measured in a browser: "
            "python -m pytest -m long tests/test_studio_browser.py -s.")
    machine = Table("waits-machine", "What machine it was", f"{LOOP:,} steps of a loop in Python: where the clock's time is "
                    "above the processor's, others were at work; where the processor's differ, the machine changed its speed.",
                    (Column("when", "when"), Column("cpu_s", "processor time, s"), Column("wall_s", "time, s")),
                    tuple({"when": when, "cpu_s": cpu, "wall_s": wall} for when, cpu, wall in loops))
    return Table("waits", "Where people wait", text, columns, tuple(rows)), machine


def _loop() -> tuple[float, float]:
    cpu, wall, total = time.process_time(), time.perf_counter(), 0
    for i in range(LOOP):
        total += i * i
    return time.process_time() - cpu, time.perf_counter() - wall


# --- kernels ------------------------------------------------------------------------------------------------------------


def _kernels(case: Case) -> Iterator[Row]:
    many, few = case.rays(MANY_RAYS), case.rays(FEW_RAYS)
    one = replace(few, directions=few.directions[:1].copy())
    mesh = case.mesh(TRIANGLES)
    embree = partial(raw_embree.embree, mesh, interpolated=False)
    shuffled = many.shuffled()
    yield _rates("rays in random order, 10⁶", ours.reused(case.reflector, shuffled), raw_embree.FACETS, embree(shuffled),
                 MANY_RAYS, "≥ 1.5")
    llvm = mitsuba_mesh.NAME.format(mitsuba_mesh.LLVM)
    yield _rates("rays in pixel order, 10⁶, one eye, arrays reused", ours.reused(case.reflector, many), llvm,
                 lambda: _mitsuba_rays(case, many), MANY_RAYS, "≥ 2")
    for name, rays, asked in (("1,000 rays a call", few, "≤ 60 µs, ≥ 1.5"), ("one ray a call", one, "≤ 15 µs")):
        yield _rates(name, ours.reused(case.reflector, rays), raw_embree.FACETS, embree(rays), len(rays.directions), asked,
                     "µs a call")
    plane, world = pictures.reference_plane(case), street()
    for name, scene, size, asked in (("picture of the plane, 1280 × 720", plane, (1280, 720), "≥ 4"),
                                     (f"picture of a street, {len(world.faces):,} triangles, 640 × 480", world, (640, 480),
                                      "≤ 40 ms, ≥ 1.6")):
        frame = pictures.frame_of(*size)
        yield _rates(name, pictures.ours(case, scene, frame), llvm,
                     partial(pictures.mitsuba, case, scene, frame, TRIANGLES, mitsuba_mesh.LLVM), size[0] * size[1], asked,
                     "ms a picture")
    glass = case.mirror.spec.glass.model_copy(update={"reflecting": "back"})
    behind = Reflector.from_mirror(design(case.mirror.spec.model_copy(update={"glass": glass})))
    rays = case.rays(GLASS_RAYS)
    out = Trace.empty(len(rays.directions))
    yield _rates("second-surface glass", lambda: reflect(behind, rays.origins, rays.directions, out=out), None, None,
                 len(rays.directions), "≥ 10 Mrays/s")


def _mitsuba_rays(case: Case, rays: Rays) -> Work:
    (tracer,) = mitsuba_mesh.tracers(case, TRIANGLES)
    if tracer.note is not None:
        raise AbsentError(tracer.note)
    return tracer.prepare(rays)


def _rates(name: str, work: Callable[[], Any], peer: str | None, make: Callable[..., Any] | None, rays: int, asked: str,
           unit: str = "Mrays/s") -> Row:
    """One line: our work and the peer's in turn. `make` is the peer's work, or makes it where it may be absent."""
    theirs, note = None, None
    if make is not None:
        theirs = make
        if peer is not None and peer.startswith("Mitsuba"):
            try:
                theirs = make()
            except AbsentError as reason:
                theirs, note = None, str(reason)
    calls = CALLS if unit == "µs a call" else 1
    works = [_repeated(each, calls) for each in ([work] if theirs is None else [work, theirs])]
    for each in works:
        each()
    times = interleaved_seconds(works) / calls
    medians = [float(np.median(column)) for column in times.T]
    told = [{"Mrays/s": 1e-6 * rays / seconds, "µs a call": 1e6 * seconds, "ms a picture": 1e3 * seconds}[unit]
            for seconds in medians]
    return {"work": name, "ours": told[0], "unit": unit, "peer": peer, "theirs": told[1] if theirs is not None else None,
            "ratio": float(np.median(times[:, 1] / times[:, 0])) if theirs is not None else None, "asked": asked, "note": note}


def _repeated(work: Work, calls: int) -> Work:
    def run() -> NDArray[Any]:
        for _ in range(calls - 1):
            work()
        return work()

    return run


def evaluation(runs: int = 15) -> Row:
    """From a specification to aim and every measure of `drive`, in this process, warm: median processor time."""
    from mirror_cad.spec.file import spec_as_json, validate_spec
    from mirror_studio.drive.measured import measure, value_of
    from mirror_studio.drive.mirrors import on_vehicle
    from mirror_studio.explore.evaluate import scene_and_asked
    from raytrace.measures.registry import measures_of

    raw, (scene, asked) = spec_as_json(load_spec(MIRROR)), scene_and_asked("motorway")
    times = []
    for _ in range(runs + 1):
        began = time.process_time()
        spec = validate_spec(raw, MIRROR)
        mirror = design(spec)
        measured = measure(on_vehicle(spec.name, Reflector.from_mirror(mirror), scene, spec, mirror), asked)
        figures = [value_of(measured, one) for one in measures_of(measured.use).values()]
        times.append(time.process_time() - began)
    told = f"{sum(one is not None for one in figures)} figures, median of {runs} after one that warms up"
    return {"work": "specification to all measures of drive, one process", "ours": 1e3 * float(np.median(times[1:])),
            "unit": "ms of processor time", "peer": None, "theirs": None, "ratio": None, "asked": "≤ 100 ms", "note": told}


# --- processes ----------------------------------------------------------------------------------------------------------


def _processes(progress: Progress) -> Iterator[Row]:
    with tempfile.TemporaryDirectory(prefix="mirror-cad-") as name:
        folder = Path(name)
        glass = folder / "glass.toml"
        _write_glass(glass)
        plate = folder / "holes.step"
        progress.step(f"waits: a plate with {HOLES}² holes")
        perforated_plate_step(plate, HOLES)
        sheet = folder / "tiles.step"
        progress.step(f"waits: a sheet of {TILES}² tiles")
        tiled_sheet_step(sheet, TILES, TILE_POLES)
        warm: list[tuple[str, list[str], str]] = [
            ("build progressive-c", _command("build", MIRROR, "--out", str(folder / "build")), "≤ 3 s, ≤ 2"),
            ("drive progressive-c", _command("drive", MIRROR, "--out", str(folder / "drive")), "≤ 4 s"),
            ("drive, glass in front", _command("drive", str(glass), "--out", str(folder / "glass")), "≤ 8 s"),
            *((f"a STEP file of {told} as a reflector",
               [sys.executable, "-c", f"from raytrace import load_reflector; load_reflector({str(path)!r})"], "≤ 10 s")
              for told, path in ((f"{HOLES * HOLES + 6:,} faces", plate), (f"{TILES * TILES:,} untrimmed splines", sheet)))]
        bare = [sys.executable, "-c", BARE]
        seconds = []
        for round_ in range(ROUNDS + 1):  # the first fills caches
            progress.step(f"waits: commands, round {round_} of {ROUNDS}")
            seconds.append([seconds_of(each) for each in (bare, *(command for _, command, _ in warm))])
        taken = np.array(seconds[1:])
        medians = np.median(taken, axis=0)
        for k, (name_, _, asked) in enumerate(warm, 1):
            (used, waited), (_, imported) = medians[k], medians[0]
            yield {"work": name_, "ours": float(waited), "unit": "s", "peer": BARE_NAME, "theirs": float(imported),
                   "ratio": float(np.median(taken[:, k, 1] / taken[:, 0, 1])), "asked": asked,
                   "note": f"{used:.1f} s of processor time"}
        progress.step("waits: the first command on a new machine")
        (first_cpu, first), (again_cpu, again), (_, imported) = (
            seconds_of(command, NUMBA_CACHE_DIR=str(folder / "numba")) for command in (warm[0][1], warm[0][1], bare))
        yield {"work": "compiling, for the first build", "ours": first - again, "unit": "s", "peer": BARE_NAME,
               "theirs": imported, "ratio": (first - again) / imported, "asked": "≤ 6 s",
               "note": f"{first_cpu - again_cpu:.1f} s of processor time, in up to three processes"}


def _command(*words: str) -> list[str]:
    return [sys.executable, "-m", "mirror_studio", *words]


def _write_glass(path: Path) -> None:
    """MIRROR as a specification of a mirror that reflects from its back."""
    preset = resources.files("mirror_cad.designs").joinpath(f"{MIRROR}.toml").read_text("utf-8")
    path.write_text(f'{preset}\n[glass]\nreflecting = "back"\n', encoding="utf-8")


def seconds_of(command: Sequence[str], **environment: str) -> tuple[float, float]:
    """User and system time of a command and of what it waits for, and the clock's, s.

    Raises
    ------
    RuntimeError
        Where it ends otherwise than well, or with a limit missed, with what it said.
    """
    began = time.perf_counter()
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=said, env=os.environ | environment)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode not in (0, 3):
            said.seek(0)
            raise RuntimeError(f"{' '.join(command)} ended with {process.returncode}: {said.read().decode(errors='replace')}")
    return usage.ru_utime + usage.ru_stime, time.perf_counter() - began
