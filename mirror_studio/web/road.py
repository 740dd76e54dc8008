"""The road as seen in a mirror on a vehicle, and the ground it shows."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from mirror_cad.mesh import SurfaceMesh
from mirror_cad.spec import MirrorSpec
from mirror_studio.drive.mirrors import DrivenMirror
from mirror_studio.drive.pictures import EYE_HEIGHT_PX, EYE_WIDTH_PX, World, camera_at, cones_of, eye_picture
from mirror_studio.drive.world import HOUSING, MM, housing_body
from mirror_studio.json_types import Json
from mirror_studio.web.backdrop import Backdrops
from mirror_studio.web.engine import (
    FINE_QUALITY,
    LAYOUTS,
    QUICK_QUALITY,
    Designed,
    Shown,
    described,
    designed,
    jpeg,
    size_of,
)
from mirror_studio.web.mirror_pose import MirrorPose
from mirror_studio.web.motorway import MountParameters, driven, driven_users_mirror, ground, surroundings, world
from mirror_studio.web.protocol import ViewSettings
from raytrace.image import photograph
from raytrace.reflector import Reflector
from raytrace.scene.bodies import Body
from raytrace.scene.lit_world import LitWorld
from raytrace.scene.mirror_scene import Lit, MirrorScene
from raytrace.scene.reference import Picture
from raytrace.viewing.bezel import housing
from raytrace.viewing.camera import Camera
from raytrace.viewing.pose import Pose
from raytrace.viewing.ray_differentials import ray_differentials
from raytrace.viewing.view import View

Array = NDArray[np.float64]
Report = Callable[[str, float], None]  # what is being done, and the share of it that is

DRAFT_MS = 14.0  # for the rays of a draft's pictures: with the design and its way to the page some 50 ms, three frames
MIN_DRAFT_PX = 14_000  # a picture; below, little is recognised (glass has much of its time in what no pixel adds to)
SLOWEST, FASTEST = 50.0, 20_000.0  # pixels a millisecond that one measurement of the pace is believed
TALLEST = 1.75  # rows over columns: beyond, a picture holds nothing but more sky and grass
FINE = "fine picture"


class _Pace:
    """How many pixels of a draft this machine makes in a millisecond, after the last ones."""

    per_ms = 800.0

    def measured(self, pixels: int, ms: float) -> None:
        self.per_ms = 0.6 * self.per_ms + 0.4 * min(max(pixels / max(ms, 1e-3), SLOWEST), FASTEST)


_pace = _Pace()
_backdrops = Backdrops()


@dataclass(frozen=True, eq=False)
class _Past:
    """The world past a mirror with its housing before it.

    `World.beside`, but that neither shades the other, so that nothing is built anew but the housing.
    """

    world: Lit
    housing: LitWorld

    def radiance(self, origins: Array, directions: Array, spread: Array) -> Array:
        """As `LitWorld.radiance`."""
        found = self.world.radiance(origins, directions, spread)
        rows = np.flatnonzero(self.housing.scene.first_triangles(origins, directions) >= 0)
        if rows.size:
            found[rows] = self.housing.radiance(origins[rows], directions[rows], spread[rows])
        return found


def show(spec: MirrorSpec, look: ViewSettings, fine: bool, users_mirror: Reflector | None, report: Report,
         early: Callable[[Shown], None] | None = None) -> Shown:
    """Design, put on the vehicle, aim and look.

    A draft has as many pixels as DRAFT_MS make; `fine` is the picture that `mirror-cad drive` takes, with the ground that is
    seen and its figures, which `early` gets before the picture is begun.

    users_mirror : another reflector, shown beside the design at equal aim.
    Raises: MirrorError for a design that cannot be, or an aim that cannot be met; what `report` raises.
    """
    start = time.perf_counter()
    one, stand = designed(spec), MountParameters.of(look)
    mirror = driven(one, stand)
    seen = {"picture": mirror} if users_mirror is None else {"picture": mirror, "own": driven_users_mirror(users_mirror, stand)}
    figures = one.figures(MirrorPose(math.radians(look.yaw_deg), math.radians(look.pitch_deg)))
    pose = mirror.pose
    road: dict[str, Json] = {"yaw_deg": math.degrees(pose.yaw), "pitch_deg": math.degrees(pose.pitch), "hand": pose.hand,
                            "eyes_m": [(eye / MM).tolist() for eye in (mirror.eyes.left, mirror.eyes.right)],
                            "mirror_m": (pose.to_vehicle(np.zeros(3)) / MM).tolist()}
    arrays = dict(one.maps)
    made = world(lambda text: report(text, 0.0))
    if fine:
        found = ground(mirror, stand)
        arrays |= found.outlines
        road |= {"figures": found.figures, "surroundings": surroundings(made)}
        if early is not None:
            early(Shown({"road": road}, {}, found.outlines))
    middle = time.perf_counter()
    views = [(name, number, each, view) for name, each in seen.items() for number, view in enumerate(views_of(each, look))]
    layout, sizes = laid_out(list(seen.values()), look)
    if not fine:
        sizes = drafted(sizes, len(views) // len(seen))
    pictures, cameras = {}, {}
    for k, (name, number, each, view) in enumerate(views):
        width, height = sizes[list(seen).index(name)]
        camera, pixel = camera_at(each, view, width, height)
        if fine:
            picture, _ = eye_picture(each, view, made, past(each, made, True), width, height,
                                     lambda share, k=k: report(FINE, (k + share) / len(views)))  # type: ignore[misc]
        else:
            picture = draft(each, view, made, camera, pixel)
        cameras[f"{name}{number}"] = [*camera.base, *camera.across, *camera.down, width, height]
        pictures[f"{name}{number}"] = jpeg(picture, FINE_QUALITY if fine else QUICK_QUALITY)
    end = time.perf_counter()
    header = described(one, fine) | {
        "figures": figures, "plane_z_mm": one.setup.plane_z_mm, "road": road, "cameras": cameras, "layout": layout,
        "sizes_mm": {name: size_of(each.views.middle.box) for name, each in seen.items()},
        "eyes_mm": [view.eye_in_mirror.tolist() for view in views_of(mirror, look)],
        "ms": {"design": 1e3 * (middle - start), "picture": 1e3 * (end - middle)}}
    return Shown(header, pictures, arrays)


def views_of(mirror: DrivenMirror, look: ViewSettings) -> list[View]:
    """From the middle between the eyes, or from the left and the right one."""
    return [mirror.views.middle] if look.eyes == "one" else [mirror.views.left, mirror.views.right]


def laid_out(mirrors: list[DrivenMirror], look: ViewSettings) -> tuple[tuple[int, int], list[tuple[int, int]]]:
    """Columns and rows of the pictures that are largest in the look's room, and the size of each mirror's: at one scale."""
    count = len(mirrors) * (1 if look.eyes == "one" else 2)
    choices = []
    for layout in LAYOUTS[count]:
        width, height = room(look, *layout)
        pixels = [camera_at(mirror, mirror.views.middle, width, height)[1] for mirror in mirrors]
        shares = [pixel / max(pixels) for pixel in pixels]
        choices.append((max(pixels), layout, [(max(16, round(s * width)), max(16, round(s * height))) for s in shares]))
    return min(choices)[1:]


def room(look: ViewSettings, columns: int, rows: int) -> tuple[int, int]:
    """Width and height of a picture among so many beside and above each other: no wider than those of `mirror-cad drive`."""
    width = max(16, look.width // columns)
    height = max(16, min(look.height // rows, round(TALLEST * width)))
    return min(width, max(16, height * EYE_WIDTH_PX // EYE_HEIGHT_PX)), height


def drafted(sizes: list[tuple[int, int]], eyes: int) -> list[tuple[int, int]]:
    """The sizes, of the same shapes, that drafts can have."""
    count = eyes * len(sizes)
    pixels = max(DRAFT_MS * _pace.per_ms, MIN_DRAFT_PX * count)
    scale = min(1.0, math.sqrt(pixels / (eyes * sum(width * height for width, height in sizes))))
    return [(max(16, round(scale * width)), max(16, round(scale * height))) for width, height in sizes]


def draft(mirror: DrivenMirror, view: View, made: World, camera: Camera, pixel: float) -> Picture:
    """One ray a pixel, of `pixel` radians; past the mirror what is kept of the eye's view."""
    beside, turn = past(mirror, made, False), view.pose.rotation
    kept = _backdrops.of(made.past, replace(camera, eye=view.eye, base=turn @ camera.base, across=turn @ camera.across,
                                            down=turn @ camera.down), pixel)
    if kept is not None:
        beside = replace(beside, world=kept)
    driven_world = MirrorScene(made.lit, beside, view.pose, made.reflectance, 0.5 * pixel, cones_of(view))
    begun = time.perf_counter()
    picture, _ = photograph(view.reflector, camera, driven_world, None, 1)
    _pace.measured(camera.columns * camera.rows, 1e3 * (time.perf_counter() - begun))
    return picture


@lru_cache(maxsize=4)
def past(mirror: DrivenMirror, made: World, fine: bool) -> _Past:
    """What the driver sees past a mirror; in drafts the housing is coarser, and not worked out how it shades itself."""
    body = housing_body(housing(mirror.whole), mirror.pose) if fine else _plain(housing(mirror.whole, 2), mirror.pose)
    return _Past(made.past, LitWorld((body,), None, made.daylight))


def _plain(shell: SurfaceMesh, pose: Pose) -> Body:
    """A housing whose corners are smooth, and which hides no sky from itself."""
    vertices = pose.to_vehicle(shell.vertices)
    faces = shell.faces if pose.hand == "left" else shell.faces[:, ::-1]  # a reflection turns them inside out
    facets, n = SurfaceMesh(vertices, faces).facet_normals(), len(vertices)
    normals = np.stack([sum(np.bincount(faces[:, k], facets[:, c], n) for k in range(3)) for c in range(3)], axis=1)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return Body(vertices, normals, np.full((n, 2), np.nan), np.ones(n), np.ascontiguousarray(faces),
                np.zeros(len(faces), dtype=np.int32), (HOUSING,))


# --- under the pointer ------------------------------------------------------------------------------------------------


def probe(one: Designed, look: ViewSettings, x: float, y: float, eye: int) -> dict[str, Json] | None:
    """What the ray through (x, y) mm of the mirror's picture plane does.

    Where it meets the mirror, by how much the mirror magnifies far things there against a flat one, and what it meets on the
    road; None where it meets no mirror.
    """
    mirror = driven(one, MountParameters.of(look))
    views = views_of(mirror, look)
    view = views[min(eye, len(views) - 1)]
    places = np.array([[x, y]])
    traced = view.trace_points(places)
    if not traced.seen[0]:
        return None
    far = ray_differentials(view, places).at()
    across, up = (float(size[0]) if np.isfinite(size[0]) else None for size in (far.horizontal, far.vertical))
    return {"mirror_mm": traced.on_mirror[0].tolist(), "across": across, "up": up,
            "road": met(world(lambda text: None), traced.points[0], traced.directions[0])}


def met(made: World, start: Array, direction: Array) -> dict[str, Json]:
    """What a ray (3,), (3,) meets: its name, and X behind the eyes, Y to the right and Z above the ground, m."""
    hits = made.lit.scene.first_hits(start, direction[None])
    triangle, away = int(hits.triangle[0]), float(hits.distance[0])
    ground_away = float(-start[2] / direction[2]) if direction[2] < 0.0 else math.inf
    if triangle >= 0 and away < ground_away:
        ends = np.cumsum([len(body.faces) for body in made.bodies])
        number = int(np.searchsorted(ends, triangle, "right"))
        what = made.named[number][0] or ("host vehicle" if number < made.host_bodies else "roadside")
    elif math.isfinite(ground_away):
        away, what = ground_away, "ground"
        side = float(start[1] + away * direction[1])
        if made.road is not None and made.road.y_min_mm <= side <= made.road.y_max_mm:
            what = "road"
    else:
        return {"what": "sky", "at_m": None}
    return {"what": what, "at_m": ((start + away * direction) / MM).tolist()}
