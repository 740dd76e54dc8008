"""Aim a preset, specification, STEP or mesh file as a mirror on the vehicle of a scene."""

from __future__ import annotations

import re
import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from mirror_cad.design_stages import design
from mirror_cad.errors import SpecError
from mirror_cad.mirror import Mirror
from mirror_cad.own_files import Hand, hand_of
from mirror_cad.spec import MirrorSpec
from mirror_cad.spec.file import load_spec
from mirror_studio.drive.world import MM, eyes_of, host_vehicle_of, pose_of
from mirror_studio.scene_file import AimSection, SceneFile
from raytrace.errors import TraceError
from raytrace.file_kinds import CAD_KINDS, conversion
from raytrace.load import load_reflector
from raytrace.mesh_files import MESH_KINDS
from raytrace.placement import Placement
from raytrace.reflector import Reflector
from raytrace.seating import Place, place_from
from raytrace.viewing.aim import Aim, aimed, shown_aim
from raytrace.viewing.bezel import visible_aperture
from raytrace.viewing.eye_views import EyeViews
from raytrace.viewing.pose import Pose
from raytrace.viewing.vehicle import Eyes, HostVehicle
from raytrace.viewing.view import box_of

SMALLEST_MM, LARGEST_MM = 10.0, 1e4  # across: what a mirror on a vehicle can be
NAME = r"[\w.-][\w. -]{0,63}"  # of a mirror, which names its files
FILES = (*CAD_KINDS, ".stl", *MESH_KINDS)


@dataclass(frozen=True, eq=False)
class DrivenMirror:
    """A mirror on the driver's vehicle: what of it reflects and is seen, its pose, and who looks at it.

    whole : the reflector without its bezel.   spec : what it was designed from, if it was.   hand : which of a pair its file
    or specification says it is, None where that says nothing.   designed : the mirror of `spec`, where it is at hand. The
    reflectors are the left-hand one's, which the pose reflects.
    """

    name: str
    whole: Reflector
    reflector: Reflector
    pose: Pose
    eyes: Eyes
    host: HostVehicle
    spec: MirrorSpec | None = None
    hand: Hand | None = None
    designed: Mirror | None = None

    @property
    def of_other_hand(self) -> str | None:
        """What is to be said where the scene has the mirror of the other side."""
        if self.hand is None or self.hand == self.pose.hand:
            return None
        who = "file" if self.spec is None else "specification"
        return (f"{self.name}: by its {who} a {self.hand}-hand mirror, while the scene's is the {self.pose.hand}-hand one: its "
                "reflection is driven")

    @cached_property
    def views(self) -> EyeViews:
        """Seen by the left eye, from the middle between the eyes, and by the right eye."""
        return EyeViews.of(self.reflector, self.pose, self.eyes)

    @property
    def placement(self) -> Placement:
        """Where it is in its file."""
        return self.whole.placement or Placement.identity("file")

    def turned(self, yaw: float, pitch: float) -> DrivenMirror:
        """The mirror with its yaw and pitch changed by angles, radians."""
        return replace(self, pose=replace(self.pose, yaw=self.pose.yaw + yaw, pitch=self.pose.pitch + pitch))

    def shown(self) -> Aim:
        """Where the flank's end and the horizon are seen."""
        return shown_aim(self.reflector, self.pose, self.eyes.middle, self.host.rear_edge(self.pose.hand))


def placements_of(names: Sequence[str], said: Sequence[str]) -> dict[str, Place]:
    """Where each of the mirrors is in its file, by what a command line says: PLACE for all files, FILE=PLACE for one.

    Raises: SpecError for a FILE that is none of the mirrors, or a second place of one; TraceError as `place_from` does.
    """
    found: dict[str, Place] = {}
    for text in said:
        name, _, place = text.rpartition("=")
        if name and name not in names:
            raise SpecError(f"--place {text}: {name!r} is none of the mirrors: {', '.join(names)}")
        if name in found:
            raise SpecError(f"--place {text}: {repr(name) + ' has' if name else 'all files have'} a place already")
        found[name] = place_from(place)
    everywhere = found.pop("", None)
    files = [name for name in names if Path(name).suffix.lower() in FILES]
    for name in found:
        if name not in files:
            raise SpecError(f"--place {name}=…: {name!r} is designed here, in mirror coordinates: only a file has a place")
    return {name: everywhere for name in files if everywhere is not None} | found


def driven_mirror(name_or_path: str, scene: SceneFile, place: Place = "auto") -> DrivenMirror:
    """Read or design a mirror, and aim it as the scene says. A designed one is traced as read back from its STEP file.

    place : where the mirror is in its file, as for `load_reflector`.

    Raises: MirrorError that says what is wrong with it.
    """
    name, reflector, spec = reflector_named(name_or_path, place)
    hand = hand_of(Path(name_or_path))
    if spec is not None:
        hand = spec.part.hand if "hand" in spec.part.model_fields_set else None
    try:
        return replace(on_vehicle(name, reflector, scene, spec), hand=hand)
    except TraceError as error:
        raise TraceError(f"{name}: {error}") from None


def reflector_named(name_or_path: str, place: Place = "auto") -> tuple[str, Reflector, MirrorSpec | None]:
    """Read or design a mirror: its name, what reflects, and what it was designed from, if it was.

    A designed one is as read back from its STEP file.

    Raises: MirrorError that says what is wrong with it.
    """
    path = Path(name_or_path)
    if path.suffix.lower() in FILES or conversion(path.suffix.lower()):
        reflector = load_reflector(path, normals="interpolated", place=place)
        if reflector.surface.triangle_count:
            try:
                _refuse_metres(reflector)
            except TraceError as error:
                raise TraceError(f"{path.stem}: {error}") from None
        return path.stem, reflector, None
    spec = load_spec(name_or_path)
    return spec.name, exported(spec), spec


def _refuse_metres(reflector: Reflector) -> None:
    """A mesh has no unit of its own: what is no size of a mirror was most likely written in another one than mm."""
    x_min, x_max, y_min, y_max = box_of(reflector)
    size = max(x_max - x_min, y_max - y_min)
    if not SMALLEST_MM <= size <= LARGEST_MM:
        unit = "metres" if size < SMALLEST_MM else "µm"
        raise TraceError(f"the mesh is {size:.3g} mm across as the driver looks at it, a mirror has {SMALLEST_MM:g} to "
                         f"{LARGEST_MM:g} mm: was it written in {unit}? Mirror files are in mm")


def exported(spec: MirrorSpec) -> Reflector:
    """The mirror of a specification, from the STEP file that it is exported to; of a right-hand one the left-hand one again.

    Written and read in the process that has the CAD kernel, which takes a second to be loaded beside all else.
    """
    mirror = design(spec)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{spec.name}.step"
        mirror.export_step_apart(path)
        return load_reflector(path, index=spec.glass.index, place="auto")


def on_vehicle(name: str, whole: Reflector, scene: SceneFile, spec: MirrorSpec | None = None, designed: Mirror | None = None,
               ) -> DrivenMirror:
    """A reflector under the scene's bezel, aimed as the scene says; `designed` : the mirror of `spec`, where it is at hand."""
    reflector = visible_aperture(whole, MM * scene.mirror.bezel_over_m)
    eyes, host, pose = eyes_of(scene), host_vehicle_of(scene), pose_of(scene)
    if scene.mirror.yaw_deg is None:
        wanted = scene.aim or AimSection()
        pose = aimed(reflector, pose, eyes.middle, host.rear_edge(pose.hand), Aim(wanted.flank_share, wanted.horizon_share))
    mirror = DrivenMirror(name, whole, reflector, pose, eyes, host, spec, designed=designed)
    mirror.views  # noqa: B018  an eye that cannot look into it is refused here
    return mirror


def named_apart(mirrors: Sequence[DrivenMirror], given: Sequence[str]) -> list[DrivenMirror]:
    """The mirrors, those of equal names told apart by what differs in what was given for them: the ending, the folders, both.

    Raises: SpecError where one is given twice, or would write no file of its name.
    """
    for mirror in mirrors:
        if not re.fullmatch(NAME, mirror.name):
            raise SpecError(f"a mirror's file is called {mirror.name!r}: rename it, its name names other files; letters, "
                            "digits, '.', '_', '-' and blanks serve")
    taken = Counter(mirror.name for mirror in mirrors)
    apart = [mirror.name for mirror in mirrors]
    for name in [name for name, count in taken.items() if count > 1]:
        rows = [k for k, mirror in enumerate(mirrors) if mirror.name == name]
        others = {each for k, each in enumerate(apart) if k not in rows}
        for k, new in zip(rows, _told_apart(name, [given[k] for k in rows], others), strict=True):
            apart[k] = new
    return [mirror if mirror.name == name else replace(mirror, name=name) for mirror, name in zip(mirrors, apart, strict=True)]


def _told_apart(name: str, given: list[str], others: set[str]) -> list[str]:
    """Another name for each of the files of one name; presets keep theirs."""
    files = [Path(each) if each.lower().endswith((*FILES, ".toml")) else None for each in given]
    sources = [each if file is None else str(file.resolve()) for each, file in zip(given, files, strict=True)]
    if len(set(sources)) < len(sources):
        raise SpecError(f"{name!r} is given twice: give each mirror once")
    folders = _differing([() if file is None else file.resolve().parent.parts for file in files])
    endings = ["" if file is None else file.suffix for file in files]
    stems = [name if file is None or file.stem == name else f"{name}-{file.stem}" for file in files]
    plain, none = [name] * len(given), [""] * len(given)
    bare: list[list[str]] = [[] for _ in given]
    for before, middle, after in ((bare, plain, endings), (folders, plain, none), (folders, plain, endings),
                                  (bare, stems, none), (folders, stems, endings)):
        found = ["-".join([*folder, stem]) + ending for folder, stem, ending in zip(before, middle, after, strict=True)]
        usable = all(re.fullmatch(NAME, each) for each in found)
        if usable and len(set(found)) == len(found) and not others.intersection(found):
            return found
    return [f"{name}-{number}" for number in range(1, len(given) + 1)]  # names too long, or taken


def _differing(folders: list[tuple[str, ...]]) -> list[list[str]]:
    """What is left of paths without the folders that all begin with, and those that all end with."""
    shared = next((k for k, column in enumerate(zip(*folders, strict=False)) if len(set(column)) > 1),
                  min(map(len, folders)))
    left = [list(parts[shared:]) for parts in folders]
    while all(left) and len({parts[-1] for parts in left}) == 1:
        left = [parts[:-1] for parts in left]
    return [[re.sub(r"[^\w.-]+", "_", part) for part in parts] for parts in left]
