"""The built-in motorway, made once, and a mirror aimed there where the page wants it on the vehicle."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mirror_studio.drive.in_plan import footprint, without_cuts
from mirror_studio.drive.mirrors import DrivenMirror, on_vehicle
from mirror_studio.drive.pictures import World
from mirror_studio.drive.world import MM
from mirror_studio.json_types import Json
from mirror_studio.scene_file import DEFAULT, AimSection, EyesSection, SceneFile, load_scene
from mirror_studio.web.engine import Designed
from mirror_studio.web.protocol import ViewSettings
from raytrace.measures.asked import NearLane
from raytrace.measures.blind_zone import blind_along
from raytrace.measures.ground import nearest_at_flank, seen_ground, seen_widths
from raytrace.reflector import Reflector
from raytrace.viewing.pose import Hand
from raytrace.visibility.plan import Polygon

Array = NDArray[np.float64]

KEPT = 6  # mirrors, as many as designs are
READING = "reading the motorway"


class MountParameters(NamedTuple):
    """Which mirror of the vehicle it is, how it is aimed, and where the eyes are, m: what changes the scene."""

    hand: Hand
    flank_share: float
    horizon_share: float
    middle_m: tuple[float, float, float]
    apart_m: float

    @staticmethod
    def of(look: ViewSettings) -> MountParameters:
        """What the page asks of the mount."""
        return MountParameters(look.hand, look.flank_share, look.horizon_share, (look.eye_x_m, look.eye_y_m, look.eye_z_m),
                     look.eyes_apart_m)


@lru_cache(maxsize=KEPT)
def scene_for(stand: MountParameters) -> SceneFile:
    """The motorway with this mirror and these eyes. On its other side the mirror's place and the lane beside are reflected."""
    scene = load_scene(DEFAULT)
    mirror, measured = scene.mirror, scene.measured
    x, y, z = mirror.centre_m
    low, high = measured.lane_m
    if stand.hand != mirror.hand:
        mirror = mirror.model_copy(update={"hand": stand.hand, "centre_m": (x, -y, z)})
        measured = measured.model_copy(update={"lane_m": (-high, -low)})
    return scene.model_copy(update={
        "eyes": EyesSection(middle_m=stand.middle_m, separation_m=stand.apart_m), "mirror": mirror, "measured": measured,
        "aim": AimSection(flank_share=stand.flank_share, horizon_share=stand.horizon_share)})


@lru_cache(maxsize=KEPT)
def driven(one: Designed, stand: MountParameters) -> DrivenMirror:
    """A design on the vehicle. Raises: TraceError where no aim shows what is asked for, or an eye is in a wrong place."""
    spec = one.mirror.spec
    return on_vehicle(spec.name, one.reflector, scene_for(stand), spec)


def driven_users_mirror(users_mirror: Reflector, stand: MountParameters) -> DrivenMirror:
    """The user's mirror at equal aim."""
    return on_vehicle("your mirror", users_mirror, scene_for(stand))


# --- the world --------------------------------------------------------------------------------------------------------


@dataclass(eq=False)
class _Kept:
    """The motorway's world, once it has been asked for."""

    lock: threading.Lock = field(default_factory=threading.Lock)
    world: World | None = None


_kept = _Kept()


def world(report: Callable[[str], None]) -> World:
    """The motorway's bodies and light, made by who asks first; `report` says so to whoever has to wait."""
    if _kept.world is None:
        report(READING)
        with _kept.lock:
            if _kept.world is None:
                made = World(load_scene(DEFAULT))
                _ = made.lit, made.past
                _kept.world = made
    return _kept.world


@lru_cache(maxsize=1)
def surroundings(made: World) -> dict[str, Json]:
    """What a plan shows around the ground that is seen, m: the road's edges and lines, the host vehicle, the others."""
    scene = load_scene(DEFAULT)
    host, road = scene.own_vehicle, scene.road
    return {"road_m": [road.left_m, road.right_m] if road else None,
            "lines": [{"y_m": line.y_m, "yellow": line.colour == "yellow",
                       "dash_m": [line.dash_m, line.period_m] if line.dash_m and line.period_m else None}
                      for line in (road.line if road else ())],
            "own_m": [host.front_m, host.rear_m, -0.5 * host.width_m, 0.5 * host.width_m],
            "bodies": [{"name": name, "corners_m": (footprint(body.vertices) / MM).tolist()}
                       for name, body in made.named if name]}


# --- the ground that is seen ------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Ground:
    """The ground that is seen, and its figures.

    Attributes
    ----------
    outlines
        By eye (left, right, both), (n, 2) of (X, Y) in m with rows of NaN between them.
    figures
        As the page shows them.
    """

    outlines: dict[str, Array]
    figures: dict[str, Json]


@lru_cache(maxsize=KEPT)
def ground(mirror: DrivenMirror, stand: MountParameters) -> Ground:
    """What a mirror shows of the ground: `raytrace.measures.ground` and `.blind_zone`, as `mirror-cad drive` measures it."""
    asked = scene_for(stand).measured
    left, right, host = mirror.views.left, mirror.views.right, mirror.host
    seen = seen_ground(left, right, host)
    widths = seen_widths(left, right, host, tuple(MM * at for at in asked.widths_at_m))
    nearest, _ = nearest_at_flank(left, right, host)
    lane = NearLane(MM * asked.lane_m[0], MM * asked.lane_m[1])
    blind = blind_along(left, right, host, lane, 0.0, float(np.radians(asked.direct_view_deg)))
    return Ground({"seen_left": _apart([without_cuts(one) for one in seen.left.outlines]),
                   "seen_right": _apart([without_cuts(one) for one in seen.right.outlines]),
                   "seen_both": _apart(seen.both.outlines)},
                  {"seen_width_m": [[one.x_mm / MM, one.either_mm / MM] for one in widths],
                   "nearest_m": nearest / MM if np.isfinite(nearest) else None, "blind_length_m": blind.total / MM})


def _apart(outlines: list[Polygon] | tuple[Polygon, ...]) -> Array:
    """Outlines (n, 2), mm, one after another in m, each ended by a row of NaN."""
    gap = np.full((1, 2), np.nan)
    return np.concatenate([part for one in outlines for part in (one / MM, gap)] or [gap])
