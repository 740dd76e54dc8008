"""A preset, specification, STEP or mesh file and a scene in, the mirror as it is aimed on the vehicle out."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from mirror_cad.errors import SpecError
from mirror_cad.mirror import design
from mirror_cad.spec import MirrorSpec
from mirror_cad.spec_file import load_spec
from mirror_studio.drive.world import MM, eyes_of, own_vehicle_of, pose_of
from mirror_studio.scene_file import AimSection, SceneFile
from raytrace.errors import TraceError
from raytrace.placement import Placement
from raytrace.reflector import Reflector, load_reflector
from raytrace.seating import Place, place_from
from raytrace.viewing.aim import Aim, aimed, shown_aim
from raytrace.viewing.bezel import visible_aperture
from raytrace.viewing.eye_views import EyeViews
from raytrace.viewing.pose import Pose
from raytrace.viewing.vehicle import Eyes, HostVehicle
from raytrace.viewing.view import box_of

SMALLEST_MM, LARGEST_MM = 10.0, 1e4  # across: what a mirror on a vehicle can be
FILES = (".step", ".stp", ".stl", ".obj", ".ply", ".off", ".gltf", ".glb", ".3mf")


@dataclass(frozen=True, eq=False)
class DrivenMirror:
    """A mirror on the driver's vehicle: what of it reflects and is seen, its pose, and who looks at it.

    whole : the reflector without its bezel.   spec : what it was designed from, if it was.
    """

    name: str
    whole: Reflector
    reflector: Reflector
    pose: Pose
    eyes: Eyes
    own: HostVehicle
    spec: MirrorSpec | None = None

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
        return shown_aim(self.reflector, self.pose, self.eyes.middle, self.own.rear_edge(self.pose.hand))


def places_of(names: Sequence[str], said: Sequence[str]) -> dict[str, Place]:
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
    path = Path(name_or_path)
    spec = None
    if path.suffix.lower() in FILES:
        name, reflector = path.stem, load_reflector(path, normals="interpolated", place=place)
    else:
        spec = load_spec(name_or_path)
        name, reflector = spec.name, exported(spec)
    try:
        if reflector.mesh is not None:
            _refuse_metres(reflector)
        return on_vehicle(name, reflector, scene, spec)
    except TraceError as error:
        raise TraceError(f"{name}: {error}") from None


def _refuse_metres(reflector: Reflector) -> None:
    """A mesh has no unit of its own: what is no size of a mirror was most likely written in another one than mm."""
    x_min, x_max, y_min, y_max = box_of(reflector)
    size = max(x_max - x_min, y_max - y_min)
    if not SMALLEST_MM <= size <= LARGEST_MM:
        unit = "metres" if size < SMALLEST_MM else "µm"
        raise TraceError(f"the mesh is {size:.3g} mm across as the driver looks at it, a mirror has {SMALLEST_MM:g} to "
                         f"{LARGEST_MM:g} mm: was it written in {unit}? Mirror files are in mm")


def exported(spec: MirrorSpec) -> Reflector:
    """The mirror of a specification, from the STEP file that it is exported to."""
    mirror = design(spec)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{spec.name}.step"
        mirror.export_step(path)
        return load_reflector(path, index=spec.glass.index)


def on_vehicle(name: str, whole: Reflector, scene: SceneFile, spec: MirrorSpec | None = None) -> DrivenMirror:
    """A reflector under the scene's bezel, aimed as the scene says."""
    reflector = visible_aperture(whole, MM * scene.mirror.bezel_over_m)
    eyes, own, pose = eyes_of(scene), own_vehicle_of(scene), pose_of(scene)
    if scene.mirror.yaw_deg is None:
        wanted = scene.aim or AimSection()
        pose = aimed(reflector, pose, eyes.middle, own.rear_edge(pose.hand), Aim(wanted.flank_share, wanted.horizon_share))
    mirror = DrivenMirror(name, whole, reflector, pose, eyes, own, spec)
    mirror.views  # noqa: B018  an eye that cannot look into it is refused here
    return mirror


def named_apart(mirrors: list[DrivenMirror]) -> None:
    """Raise SpecError where two mirrors would write the same files, or one no file of its name."""
    names = [mirror.name for mirror in mirrors]
    for name in names:
        if not re.fullmatch(r"[\w.-][\w. -]{0,63}", name):
            raise SpecError(f"a mirror's file is called {name!r}: rename it, its name names other files; letters, digits, '.', "
                            "'_', '-' and blanks serve")
        if names.count(name) > 1:
            raise SpecError(f"two of the mirrors are called {name!r}: rename one, its name names its files")
