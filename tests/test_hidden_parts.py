"""Fields, widths, blind zones and lines in random scenes, against every direction and point of a dense grid by itself.

The evaluation beside the program is a dumb one: plane and spherical mirrors in closed form, the point of reflection bisected
for each direction or point, the outline and the host vehicle's box asked one by one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from mirror_cad.surfaces.quadric import Quadric
from raytrace.measures.asked import NearLane
from raytrace.measures.blind_zone import FROM_MM, TO_MM, blind_along
from raytrace.measures.eye_fields import eye_fields
from raytrace.measures.ground import seen_widths
from raytrace.reflector import Reflector
from raytrace.surfaces.quadric import QuadricFace
from raytrace.viewing.eye_views import EyeViews
from raytrace.viewing.pose import Hand, Pose
from raytrace.viewing.vehicle import Eyes, HostVehicle
from raytrace.visibility.line_image import line_images, road_line
from tests.test_occlusion import inside_somewhere

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

BISECTIONS, SECANTS = 10, 8
SAME_DEG, SAME_MM = 1e-6, 1e-2  # a grid's point this near to an end may lie on either side of it
FAR_MM = 1e9
AT_MM = (4_000.0, 10_000.0, 30_000.0)


@dataclass(frozen=True, eq=False)
class Scene:
    """A mirror in the plane z = 0 (radius inf) or on a sphere that touches it, of 2·U × 2·V in its own angles or mm."""

    radius: float
    half: tuple[float, float]
    pose: Pose
    eyes: Eyes
    own: HostVehicle
    lane: NearLane
    line_y: float

    def reflector(self) -> Reflector:
        u, v = self.half
        t, one = np.linspace(-1.0, 1.0, 101)[:-1], np.ones(100)
        box = np.concatenate([np.stack(side, axis=1) for side in ((t, -one), (one, t), (-t, one), (-one, -t))]) * [u, v]
        if np.isinf(self.radius):
            return Reflector(QuadricFace(Quadric("plane", np.zeros(3), np.eye(3), 0.0), (box,)))
        upright = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
        sphere = Quadric("sphere", np.array([0.0, 0.0, -self.radius]), upright, self.radius)
        return Reflector(QuadricFace(sphere, (box,)))

    def seen(self, eye: Array, targets: Array, far: bool) -> Mask:
        """Whether an eye sees points (n, 3), or far directions, in the mirror beside the host vehicle."""
        turn, offset = frame_of(self.pose)
        on = on_plane if np.isinf(self.radius) else on_sphere
        at_eye, at = (eye - offset) @ turn, targets @ turn if far else (targets - offset) @ turn
        point, met = on(self.radius, at_eye, at, far)
        if np.isinf(self.radius):
            u, v = point[:, 0], point[:, 1]
        else:
            u, v = np.arctan2(point[:, 0], point[:, 2] + self.radius), np.arcsin(np.clip(point[:, 1] / self.radius, -1.0, 1.0))
        met &= (np.abs(u) < self.half[0]) & (np.abs(v) < self.half[1])
        start = point @ turn.T + offset
        end = start + FAR_MM * targets if far else targets
        met[met] &= ~inside_somewhere(self.own, start[met], end[met])
        return met


def frame_of(pose: Pose) -> tuple[Array, Array]:
    """Mirror to vehicle, p = turn·m + offset, as `Pose` says it."""
    cy, sy, cp, sp = np.cos(pose.yaw), np.sin(pose.yaw), np.cos(pose.pitch), np.sin(pose.pitch)
    straight = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    yaw, pitch = [[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]], [[cp, 0.0, -sp], [0.0, 1.0, 0.0], [sp, 0.0, cp]]
    turn = np.array(yaw) @ np.array(pitch) @ straight
    offset = pose.centre + straight @ pose.pivot - turn @ pose.pivot
    side = np.diag([1.0, -1.0 if pose.hand == "right" else 1.0, 1.0])
    return side @ turn, side @ offset


def on_plane(radius: float, eye: Array, targets: Array, far: bool) -> tuple[Array, Mask]:
    """Where the plane z = 0 reflects targets to an eye: on the straight line from the eye's image."""
    image = eye * [1.0, 1.0, -1.0]
    way = targets if far else targets - image
    before = way[:, 2] > 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        point = image - (image[2] / way[:, 2])[:, None] * way
    return np.where(before[:, None], point, 0.0), before


def on_sphere(radius: float, eye: Array, targets: Array, far: bool) -> tuple[Array, Mask]:
    """The same for a sphere about (0, 0, −R): in the plane of eye, centre and target, n halves the angle at R·n."""
    centre = np.array([0.0, 0.0, -radius])
    a = (eye - centre) / np.linalg.norm(eye - centre)
    b = targets if far else targets - centre
    b = b / np.linalg.norm(b, axis=1, keepdims=True)
    angle = np.arccos(np.clip(b @ a, -1.0, 1.0))[:, None]

    def halved(t: Array) -> tuple[Array, Array, Array]:
        """By how much n is nearer to the target than to the eye, n, and the cosine of its angle to the eye."""
        n = (np.sin((1.0 - t[:, None]) * angle) * a + np.sin(t[:, None] * angle) * b) / np.sin(angle)
        q = centre + radius * n
        to_eye, to_target = eye - q, targets if far else targets - q
        to_eye, to_target = (one / np.linalg.norm(one, axis=1, keepdims=True) for one in (to_eye, to_target))
        cosine = np.einsum("ij,ij->i", n, to_eye)
        return np.einsum("ij,ij->i", n, to_target) - cosine, q, cosine

    low, high = np.zeros(len(b)), np.ones(len(b))
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        nearer = halved(middle)[0] > 0.0
        low, high = np.where(nearer, low, middle), np.where(nearer, middle, high)
    at_low, at_high = halved(low)[0], halved(high)[0]
    for _ in range(SECANTS):
        with np.errstate(divide="ignore", invalid="ignore"):
            then = high - at_high * (high - low) / (at_high - at_low)
        then = np.where(np.isfinite(then), then, high)
        low, at_low, high, at_high = high, at_high, then, halved(then)[0]
    off, point, cosine = halved(high)
    return point, (cosine > 0.0) & (np.abs(off) < 1e-12)


def random_scene(seed: int) -> Scene:
    """A mirror that may reach into the host vehicle's width, eyes and a host of any size, either hand."""
    rng = np.random.default_rng(seed)
    hand: Hand = "left" if seed % 2 else "right"
    radius = np.inf if rng.random() < 0.2 else rng.uniform(350.0, 3000.0)
    half = (rng.uniform(50.0, 150.0), rng.uniform(50.0, 200.0))
    if np.isfinite(radius):
        half = (np.arcsin(half[0] / radius), np.arcsin(half[1] / radius))
    eye = np.array([rng.uniform(-150.0, 150.0), rng.uniform(-700.0, 200.0), rng.uniform(900.0, 2600.0)])
    centre = np.array([rng.uniform(-1100.0, -450.0), rng.uniform(-1400.0, -500.0), eye[2] + rng.uniform(-350.0, 150.0)])
    wanted = np.array([1.0, -np.tan(np.radians(rng.uniform(-5.0, 25.0))), -np.tan(np.radians(rng.uniform(-3.0, 12.0)))])
    normal = (eye - centre) / np.linalg.norm(eye - centre) + wanted / np.linalg.norm(wanted)
    normal /= np.linalg.norm(normal)
    pose = Pose(centre, np.array([0.0, 0.0, -40.0]), float(np.arctan2(normal[1], normal[0])), float(np.arcsin(normal[2])), hand)
    own = HostVehicle(rng.uniform(300.0, 1700.0), rng.uniform(-3000.0, 400.0), rng.uniform(600.0, 9000.0),
                     rng.uniform(400.0, 3500.0))
    near, line = -rng.uniform(200.0, 2500.0), -rng.uniform(200.0, 4000.0)
    lane, side = (near - 3500.0, near), -1.0 if hand == "right" else 1.0
    lane = lane if side > 0.0 else (-lane[1], -lane[0])
    eyes = Eyes(eye * [1.0, side, 1.0], rng.uniform(0.0, 80.0))
    return Scene(float(radius), half, pose, eyes, own, NearLane(*lane), side * line)


def differences(intervals: Array, at: Array, seen: Mask, same: float) -> Array:
    """The places of a grid that intervals (k, 2) and the dumb evaluation disagree about, but for those at an end."""
    inside = np.zeros(len(at), dtype=np.bool_)
    for a, b in intervals:
        inside |= (at >= a) & (at <= b)
    ends = np.append(intervals.ravel(), np.inf)
    result: Array = at[(inside != seen) & (np.abs(at[:, None] - ends).min(axis=1) > same)]
    return result


def check(seed: int, dense: int) -> int:
    """Compare a scene's figures with the dumb ones; returns how many intervals there were."""
    scene = random_scene(seed)
    views = EyeViews.of(scene.reflector(), scene.pose, scene.eyes)
    found = 0
    azimuth = np.linspace(-180.0, 180.0, dense)
    ways = np.stack([np.cos(np.radians(azimuth)), np.sin(np.radians(azimuth)), np.zeros(dense)], axis=1)
    fields = eye_fields(views, scene.own).horizon_clear
    for eye, field in ((scene.eyes.left, fields.left), (scene.eyes.right, fields.right)):
        odd = differences(np.array(field).reshape(-1, 2), azimuth, scene.seen(eye, ways, far=True), SAME_DEG)
        assert odd.size == 0, f"scene {seed}: horizon {field} is wrong at {odd[:3]}"
        found += len(field)
    y = np.linspace(-30_000.0, 30_000.0, dense)
    for width in seen_widths(views.left, views.right, scene.own, AT_MM):
        points = np.stack([np.full(dense, width.x_mm), y, np.zeros(dense)], axis=1)
        left, right = (scene.seen(eye, points, far=False) for eye in (scene.eyes.left, scene.eyes.right))
        for name, ends, seen in (("either", width.either, left | right), ("both", width.both, left & right)):
            odd = differences(ends, y, seen, SAME_MM)
            assert odd.size == 0, f"scene {seed}: ground {name} at X = {width.x_mm:g}, {ends.tolist()}, is wrong at {odd[:3]}"
            found += len(ends)
    x = np.linspace(FROM_MM, TO_MM, dense)
    middle = 0.5 * (scene.lane.y_min_mm + scene.lane.y_max_mm)
    points = np.stack([x, np.full(dense, middle), np.zeros(dense)], axis=1)
    shown = scene.seen(scene.eyes.left, points, far=False) | scene.seen(scene.eyes.right, points, far=False)
    limit = np.radians(95.0)
    direct = np.arctan2(np.abs(middle - scene.eyes.middle[1]), scene.eyes.middle[0] - x) <= limit
    blind = blind_along(views.left, views.right, scene.own, scene.lane)
    odd = differences(blind.of(0), x, ~(shown | direct), SAME_MM)
    assert odd.size == 0, f"scene {seed}: blind zone {blind.of(0).tolist()} is wrong at {odd[:3]}"
    # A line on the road from 3 to 80 m, at even angles as seen from the mirror.
    away = float(np.hypot(scene.line_y - scene.pose.centre[1], scene.pose.centre[2]))
    along = away * np.tan(np.linspace(np.arctan(3000.0 / away), np.arctan(80_000.0 / away), dense))
    points = np.stack([along, np.full(dense, scene.line_y), np.zeros(dense)], axis=1)
    images = line_images(views.middle, road_line(scene.line_y, 3000.0, 80_000.0), scene.own)
    ends = np.sort(np.array([image.along_mm[[0, -1]] for image in images]).reshape(-1, 2), axis=0) + 3000.0
    odd = differences(ends, along, scene.seen(scene.eyes.middle, points, far=False), SAME_MM)
    assert odd.size == 0, f"scene {seed}: line {ends.tolist()} is wrong at {odd[:3]}"
    return found + len(blind.low) + len(images)


@pytest.mark.parametrize("first", [0, 5, 10])
def test_random_scenes_are_as_every_ray_by_itself_says(first: int) -> None:
    assert sum(check(seed, 4_001) for seed in range(first, first + 5)) > 20


@pytest.mark.long
@pytest.mark.parametrize("first", range(100, 300, 10))
def test_many_random_scenes_are_as_every_one_of_many_rays_says(first: int) -> None:
    assert sum(check(seed, 100_001) for seed in range(first, first + 10)) > 40
