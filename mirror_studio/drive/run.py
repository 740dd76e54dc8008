"""Make the files of mirrors in a scene: what the driver sees, all measures, drawings, and a sheet of it all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from mirror_cad.spec.file import spec_as_json
from mirror_studio.build.folder import MANIFEST, new_set
from mirror_studio.build.pipeline import hashes, refuse_unreflected, stated_placement, versions, write_json, write_png
from mirror_studio.drive.as_json import driven_as_json
from mirror_studio.drive.in_plan import Array, footprint
from mirror_studio.drive.lines import line_drawings
from mirror_studio.drive.maps import magnification_maps
from mirror_studio.drive.measured import MainFigures, Measured, asked_of, main_figures, measure
from mirror_studio.drive.mirrors import DrivenMirror, driven_mirror, named_apart
from mirror_studio.drive.pictures import World, both_eyes
from mirror_studio.drive.plan import ground_plans
from mirror_studio.drive.sensitivity import sensitivity
from mirror_studio.drive.sheet import picture_name, write_sheet
from mirror_studio.drive.table import write_csv
from mirror_studio.drive.turned import turned_drawing
from mirror_studio.drive.world import MM
from mirror_studio.json_types import JsonObject
from mirror_studio.progress import Progress
from mirror_studio.scene_file import SceneFile
from raytrace.seating import Place


def drive(names: Sequence[str], scene: SceneFile, out: Path, progress: Progress,
          placements: Mapping[str, Place] | None = None) -> JsonObject:
    """Make the files of some mirrors in one scene in `out`, which is replaced as a whole; returns what measures.json holds.

    placements : by name, where a mirror is in its file; "auto" for what is not in it.

    Raises: MirrorError, with nothing written.
    """
    with new_set(out) as folder, ThreadPoolExecutor(1) as writer:  # PNG is made while figures are: zlib needs no interpreter
        mirrors: list[DrivenMirror] = []
        for name in names:
            progress.step(f"{name}: making and aiming")
            mirrors.append(driven_mirror(name, scene, (placements or {}).get(name, "auto")))
            if mirrors[-1].spec is None:
                stated_placement(mirrors[-1].name, mirrors[-1].whole, progress)
            if mirrors[-1].of_other_hand:
                progress.step(f"note: {mirrors[-1].of_other_hand}")
        mirrors = named_apart(mirrors, names)
        progress.step(f"{scene.name}: reading bodies")
        world = World(scene)
        for line in world.left_out:
            progress.step(f"{scene.name}: left out: {line}" if "left out" not in line else line)
        bodies = {name: body for name, body in world.named if name}
        asked = asked_of(scene, bodies)
        measured, changes, rays, written = [], [], {}, []
        for mirror in mirrors:
            progress.step(f"{mirror.name}: what both eyes see")
            picture, rays[mirror.name] = both_eyes(mirror, world, progress.share)
            refuse_unreflected(mirror.name, rays[mirror.name], mirror.placement)
            written.append(writer.submit(write_png, folder / picture_name(mirror.name), picture))
            progress.step(f"{mirror.name}: measures")
            measured.append(measure(mirror, asked))
            progress.step(f"{mirror.name}: sensitivity")
            changes.append(sensitivity(mirror, lambda each: main_figures(each, asked), MM * scene.mirror.bezel_over_m))
        progress.step("drawings and sheet")
        for each in written:
            each.result()
        content = _write(folder, scene, measured, changes, rays,
                         [(name, footprint(body.vertices)) for name, body in bodies.items()], world.left_out)
    progress.step(f"done: open {out / 'index.html'}")
    return content


def _write(folder: Path, scene: SceneFile, measured: list[Measured], changes: list[dict[str, MainFigures]],
           rays: dict[str, dict[str, int]], footprints: list[tuple[str, Array]], left_out: list[str]) -> JsonObject:
    magnification_maps(folder / "maps.svg", measured)
    lines_width = line_drawings(folder / "lines.svg", measured)
    turned_drawing(folder / "turned.svg", measured)
    ground_plans(folder / "plan.svg", measured, scene, footprints)
    names = [each.mirror.name for each in measured]
    content = {name: driven_as_json(each, change, rays[name])
               for name, each, change in zip(names, measured, changes, strict=True)}
    write_json(folder / "measures.json", content)
    write_csv(folder / "measures.csv", measured)
    write_sheet(folder / "index.html", scene, measured, changes, lines_width, left_out)
    specs = {each.mirror.name: spec_as_json(each.mirror.spec) for each in measured if each.mirror.spec is not None}
    write_json(folder / MANIFEST, {"schema": 1, "scene": scene.model_dump(mode="json", exclude_none=True), "specs": specs,
                                   "left_out": left_out,
                                   "versions": versions(), "files": hashes(folder)})
    return content
