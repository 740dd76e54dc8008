"""Pictures, maps and figures of a design for the page: all from `mirror_cad` and `raytrace`."""

from __future__ import annotations

import io
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from mirror_cad.design_stages import design
from mirror_cad.designed import reference_curvature
from mirror_cad.deviation import against_design
from mirror_cad.eyes import ocular_points
from mirror_cad.mirror import Mirror
from mirror_cad.outline import Outline
from mirror_cad.sections import SagDerivatives
from mirror_cad.spec import MirrorSpec
from mirror_cad.surfaces.differential import ShapeOperator, principal_curvatures_of, shape_operator, shape_operator_of_sag
from mirror_studio.json_types import Json
from mirror_studio.viewing_setup import ViewingSetup
from mirror_studio.web.mirror_pose import MirrorPose, aimed
from mirror_studio.web.protocol import ViewSettings
from raytrace.image import photograph
from raytrace.measures.field_of_view import traced_fields_of_view
from raytrace.measures.lane import lane_straightness_percent
from raytrace.measures.registry import measures_of, registered
from raytrace.rays import Status
from raytrace.reflector import TRIM_CHORD_MM, Reflector
from raytrace.scene.reference import Picture, landed, load_picture
from raytrace.surfaces.bspline import BSplineFace
from raytrace.surfaces.plate import Plate
from raytrace.surfaces.trimming import Trimming
from raytrace.trace import reflect
from raytrace.viewing.camera import Frame
from raytrace.viewing.pose import STRAIGHT, Pose
from raytrace.viewing.ray_differentials import ray_differentials
from raytrace.viewing.view import View, box_of

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

MAP = (61, 91)  # places of the maps, across and up: odd, so that the box's two middle lines are among them
LAW_PLACES = 161
SHOWN_CHORD_MM = 0.2  # of the outline in maps and plans: less than a pixel
QUICK_SAMPLES, FINE_SAMPLES = 1, 4  # a direction, in the pixels that need more than one
QUICK_ROOM = (640, 480)  # pixels for all pictures while a slider moves; fine ones fill what the page has
QUICK_QUALITY, FINE_QUALITY = 80, 92  # of the JPEG
LAYOUTS = {1: ((1, 1),), 2: ((2, 1), (1, 2)), 4: ((4, 1), (2, 2))}  # columns and rows that so many pictures may stand in
# What the page has columns of its own for.
IN_FIGURES = {"h_fov_section_deg", "h_fov_traced_deg", "v_fov_left_section_deg", "v_fov_left_traced_deg",
              "lane_straightness_percent"}
SURELY_BEFORE_MM = 1.0  # of the places of the map: whether an eye that is nearer is before the mirror, its rim tells
CACHED = 6  # designs kept: undo, redo and the pinned one come at once


@dataclass(frozen=True, eq=False)
class Designed:
    """A designed mirror with what the page shows of it. The expensive parts are made when first asked for."""

    mirror: Mirror
    setup: ViewingSetup
    picture: Picture
    reflector: Reflector

    @cached_property
    def maps(self) -> dict[str, Array]:
        """Over the box, (columns, rows): height (mm), kx and ky (1/m), and the deviation of k1 and k2 (%).

        The laws asked for and those realised along y = 0, (n,), 1/m; the outline (n, 2), mm.
        """
        mirror = self.mirror
        x_min, x_max, y_min, y_max = mirror.box
        x, y = np.linspace(x_min, x_max, MAP[0]), np.linspace(y_min, y_max, MAP[1])
        z, shape = _shape_on(mirror, x, y)
        designed = mirror.curvature.shape(x)
        percent = _percent(shape, designed, mirror.curvature.rms(mirror.outline))
        along = np.linspace(x_min, x_max, LAW_PLACES)
        realised = _shape_on(mirror, along, np.zeros(1))[1]
        asked = mirror.curvature.shape(along)
        return {"z": z, "kx": 1e3 * shape.w11, "ky": 1e3 * shape.w22, "k1_percent": percent[0], "k2_percent": percent[1],
                "law_x": 1e3 * asked.w11, "law_y": 1e3 * asked.w22, "real_x": 1e3 * realised.w11[:, 0],
                "real_y": 1e3 * realised.w22[:, 0], "outline": _shown(mirror.outline)}

    @cached_property
    def deviations(self) -> dict[str, float | None]:
        """The largest and RMS deviation from the laws over the mirror, as deviation.json's `total` has them, %."""
        mirror = self.mirror
        total = against_design(mirror.curvature, mirror.outline, mirror.reference, mirror.surface)
        return {"k1_max_percent": total.k1.max_percent, "k2_max_percent": total.k2.max_percent,
                "kx_max_percent": total.kx.max_percent, "ky_max_percent": total.ky.max_percent,
                "shape_rms_percent": total.shape.rms_percent}

    def figures(self, turn: MirrorPose) -> dict[str, Json]:
        """The figures of metrics.json, under its names: fields of view in degrees, lane straightness in percent."""
        mirror, eye = self.mirror, turn.to_mirror(self.setup.eye)
        surface = self.reflector.surface
        section = mirror.section_fields_of_view()
        traced = traced_fields_of_view(surface, eye, mirror.box, mirror.left_height_mm)
        return {"h_fov_deg": {"section": math.degrees(section[0]), "traced": _finite(math.degrees(traced[0]))},
                "v_fov_left_deg": {"section": math.degrees(section[1]), "traced": _finite(math.degrees(traced[1]))},
                "lane_straightness_percent": {
                    "traced": lane_straightness_percent(surface, eye, turn.lane(self.setup.lane), mirror.box)}}

    def measures(self, turn: MirrorPose, fine: bool) -> list[dict[str, str | float | None]]:
        """The registered measures of the mirror alone that `figures` does not have, as the page shows them.

        While a slider moves those alone that have a name of their own; families are asked when the hand rests.

        Raises: TraceError for an eye that is not before the mirror.
        """
        own = any(one.scope == "setup" and name not in IN_FIGURES for name, one in registered().items())
        before = float(turn.to_mirror(self.setup.eye)[2]) > max(float(self.maps["z"].max()), 0.0) + SURELY_BEFORE_MM
        if before and not own and not fine:
            return []
        use = self.setup.in_use(self.reflector, self.mirror)
        seen = replace(use, setup=replace(use.setup, eye=turn.to_mirror(self.setup.eye)))
        return [{"name": name, "title": one.title, "unit": one.unit, "decimals": one.decimals, "definition": one.definition,
                 "value": one.value(seen)} for name, one in measures_of(seen, "setup").items() if name not in IN_FIGURES]

    def radii(self) -> dict[str, float | None]:
        """The radii realised at the middle of the box and the smallest ones over it, mm, signed; None where flat."""
        result: dict[str, float | None] = {}
        for axis in ("x", "y"):
            kappa = self.maps[f"k{axis}"]
            result[f"r{axis}_centre_mm"] = _radius(kappa[MAP[0] // 2, MAP[1] // 2])
            result[f"r{axis}_smallest_mm"] = _radius(kappa.flat[int(np.argmax(np.abs(kappa)))])
        return result

    def ground(self, turn: MirrorPose, eye: Array) -> Array:
        """Where the rays by way of the outline land on the reference plane, (n, 2) mm; NaN where they do not."""
        outline = self.maps["outline"]
        points, directions = self.reflector.surface.reflected_at(turn.to_mirror(eye), outline[:, 0], outline[:, 1])
        return _land(turn, points, directions, self.setup.plane_z_mm)


@lru_cache(maxsize=CACHED)
def designed(spec: MirrorSpec) -> Designed:
    """Design a mirror and make ready what is seen in it. Raises: MirrorError."""
    picture = _picture(spec.scene.image)
    mirror = design(spec)
    setup = ViewingSetup.of(spec, mirror.box)
    loops, trimming = _trimming(mirror.outline)
    face = BSplineFace(mirror.surface, loops)
    face.__dict__["trimming"] = trimming  # the one that it would make of the same loops
    surface = Plate(BSplineFace(mirror.front, loops), face, spec.glass.index) if spec.glass.reflecting == "back" else face
    return Designed(mirror, setup, picture, Reflector(surface))


@lru_cache(maxsize=4)
def _picture(image: str) -> Picture:
    return load_picture(image)


@lru_cache(maxsize=4)
def _trimming(outline: Outline) -> tuple[tuple[Array, ...], Trimming]:
    loops = (outline.polyline(TRIM_CHORD_MM),)
    return loops, Trimming.of(loops)


@lru_cache(maxsize=4)
def _shown(outline: Outline) -> Array:
    return outline.polyline(SHOWN_CHORD_MM)


# --- what a request is answered with ----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Shown:
    """What a request is answered with: JPEG pictures and arrays by name, the rest as JSON holds it."""

    header: dict[str, Json]
    pictures: dict[str, bytes]
    arrays: dict[str, Array]


def show(spec: MirrorSpec, look: ViewSettings, fine: bool = False, users_mirror: Reflector | None = None,
         progress: Callable[[float], None] | None = None) -> Shown:
    """Design a mirror, look into it and measure.

    Parameters
    ----------
    spec
        The mirror.
    look
        From where and at what the driver looks, and how large the picture is.
    fine
        With every edge smoothed and the deviations from the laws, which takes longer.
    users_mirror
        Another reflector in mirror coordinates, shown beside the design at equal aim: the ray to the middle of its box is
        reflected where the design sends that to its middle.
    progress
        Called with the share of a picture that is done.

    Raises
    ------
    MirrorError
        For a design that cannot be, or that the eye does not see; and what `progress` raises.
    """
    start = time.perf_counter()
    one = designed(spec)
    turn = MirrorPose(math.radians(look.yaw_deg), math.radians(look.pitch_deg))
    eyes = eyes_of(one.setup.eye, look)
    figures = one.figures(turn)
    arrays = one.maps | {f"ground{number}": one.ground(turn, eye) for number, eye in enumerate(eyes)}
    middle = time.perf_counter()
    scene = one.setup.scene(one.picture, spec)
    samples, quality = (FINE_SAMPLES, FINE_QUALITY) if fine else (QUICK_SAMPLES, QUICK_QUALITY)
    seen = mirrors_in_view(one, turn, users_mirror)
    width, height = (look.width, look.height) if fine else map(min, (look.width, look.height), QUICK_ROOM)
    layout, framed = laid_out([box for _, _, box in seen], len(eyes), width, height)
    pictures, frames = {}, dict(zip(("picture", "own"), framed, strict=False))
    for (name, frame), (reflector, each, _) in zip(frames.items(), seen, strict=True):
        for number, eye in enumerate(eyes):
            view, _ = photograph(reflector, frame.camera(each.to_mirror(eye)), each.seen_by(scene), progress, samples)
            pictures[f"{name}{number}"] = jpeg(view, quality)
    end = time.perf_counter()
    header = described(one, fine) | {
        "figures": figures, "measures": one.measures(turn, fine), "plane_z_mm": one.setup.plane_z_mm,
        "eyes_mm": [turn.to_mirror(eye).tolist() for eye in eyes],
        "frames": {name: [frame.left, frame.top, frame.pixel, frame.columns, frame.rows] for name, frame in frames.items()},
        "scene_mm": list(scene.bounds()), "layout": layout,
        "sizes_mm": {name: size_of(box) for name, (_, _, box) in zip(frames, seen, strict=True)},
        "ms": {"design": 1e3 * (middle - start), "picture": 1e3 * (end - middle)},
    }
    return Shown(header, pictures, arrays)


def described(one: Designed, fine: bool) -> dict[str, Json]:
    """What an answer says of a design, whatever is seen in it."""
    mirror = one.mirror
    return {"radii": one.radii(), "box_mm": list(mirror.box), "notes": list(mirror.notes),
            "matched": dict([mirror.matched]) if mirror.matched else {},
            "fit": {"spans": list(mirror.fit.spans), "degree": mirror.fit.degree, "met": mirror.fit.met,
                    "position_error_mm": mirror.fit.position_error_mm,
                    "curvature_error_percent": mirror.fit.curvature_error_percent},
            "deviations": one.deviations if fine and mirror.spec.has_laws else None, "fine": fine}


def eyes_of(eye: Array, look: ViewSettings) -> list[Array]:
    """The one eye, or the left and the right one beside it."""
    return [eye] if look.eyes == "one" else list(ocular_points(eye))


def fitted(box: Box, width: int, height: int) -> Frame:
    """The largest frame about a box that fits into so many pixels."""
    whole = Frame.around(box, 1000)
    return Frame.around(box, max(16, int(min(width, height * whole.columns / whole.rows))))


def laid_out(boxes: list[Box], eyes: int, width: int, height: int) -> tuple[tuple[int, int], list[Frame]]:
    """Columns and rows of the pictures that are largest in so many pixels, and a frame about each box, all of one scale."""
    def pixel(columns: int, rows: int) -> float:
        return max(fitted(box, width // columns, height // rows).pixel for box in boxes)

    layout = min(LAYOUTS[eyes * len(boxes)], key=lambda one: pixel(*one))
    return layout, [Frame.around(box, max(16, round(Frame.around(box, 1).pixel / pixel(*layout)))) for box in boxes]


def size_of(box: Box) -> list[float]:
    """Width and height."""
    return [box[1] - box[0], box[3] - box[2]]


def jpeg(picture: Picture, quality: int) -> bytes:
    """A picture as JPEG; fine ones without thinned-out colour."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, format="JPEG", quality=quality, subsampling=0 if quality == FINE_QUALITY else 2)
    return buffer.getvalue()


def probe(one: Designed, look: ViewSettings, x: float, y: float, eye: int) -> dict[str, Json] | None:
    """What the ray through (x, y) mm of the picture plane does.

    Where it meets the mirror and lands, and by how much the mirror magnifies far things there against a flat one, across and
    up; None where it meets no mirror.
    """
    turn = MirrorPose(math.radians(look.yaw_deg), math.radians(look.pitch_deg))
    eyes = eyes_of(one.setup.eye, look)
    pose = Pose(np.zeros(3), np.zeros(3), turn.yaw, turn.pitch)  # turned about the same point, the same way
    view = View(one.reflector, pose, STRAIGHT @ eyes[min(eye, len(eyes) - 1)])
    places = np.array([[x, y]])
    traced = view.trace_points(places)
    if not traced.seen[0]:
        return None
    far = ray_differentials(view, places).at()
    landed = _land(turn, traced.on_mirror, pose.directions_to_mirror(traced.directions), one.setup.plane_z_mm)[0]
    return {"mirror_mm": traced.on_mirror[0].tolist(), "across": _finite(float(far.horizontal[0])),
            "up": _finite(float(far.vertical[0])), "landed_mm": landed.tolist() if np.isfinite(landed).all() else None}


# --- parts ------------------------------------------------------------------------------------------------------------


def mirrors_in_view(one: Designed, turn: MirrorPose, users_mirror: Reflector | None) -> list[tuple[Reflector, MirrorPose, Box]]:
    """The design, and the user's mirror if there is one: how each stands, and its box."""
    beside = [] if users_mirror is None else [(users_mirror, *pose_of_users_mirror(one, turn, users_mirror))]
    return [(one.reflector, turn, one.mirror.box), *beside]


def pose_of_users_mirror(one: Designed, turn: MirrorPose, users_mirror: Reflector) -> tuple[MirrorPose, Box]:
    """How the other reflector stands and its box, as `show` says. Raises: TraceError where the eye's ray misses it."""
    from raytrace.errors import TraceError

    box = box_of(users_mirror)
    centre = np.array([0.5 * (box[0] + box[1]), 0.5 * (box[2] + box[3])])
    above = np.array([[centre[0], centre[1], float(users_mirror.outline()[:, 2].max()) + one.mirror.spec.eye.distance_mm]])
    met = reflect(users_mirror, above[0], np.array([[0.0, 0.0, -1.0]]))
    if met.status[0] != Status.REFLECTED:
        raise TraceError(f"the uploaded mirror does not reflect at the middle of its box, ({centre[0]:.1f}, {centre[1]:.1f}) "
                         "mm, seen along −z: is it in mirror coordinates?")
    x, y = (0.5 * (one.mirror.box[i] + one.mirror.box[i + 1]) for i in (0, 2))
    place, out = one.reflector.surface.reflected_at(turn.to_mirror(one.setup.eye), np.array([x]), np.array([y]))
    stood = aimed(met.points[0], met.normals[0], turn.to_scene(place[0]), one.setup.eye, out[0] @ turn.rotation.T)
    return stood, box


def _land(turn: MirrorPose, points: Array, directions: Array, z_mm: float) -> Array:
    """Where rays in the mirror's coordinates meet the plane z = z_mm of the scene, (n, 2) mm."""
    return landed(turn.to_scene(points), directions @ turn.rotation.T, z_mm)[:, :2]


def _shape_on(mirror: Mirror, x: Array, y: Array) -> tuple[Array, ShapeOperator]:
    """Height and shape operator of the fitted surface on a grid, (len(x), len(y))."""
    surface = mirror.surface
    if surface.weights is not None:
        d = surface.on_grid(x, y)
        return d["s"][..., 2], shape_operator(d)
    heights = surface.on_grid(x, y, component=2)
    sag = SagDerivatives(*(heights[key] for key in ("s", "u", "v", "uu", "uv", "vv")))
    return sag.z, shape_operator_of_sag(sag)


def _percent(shape: ShapeOperator, asked: ShapeOperator, rms: float) -> tuple[Array, Array]:
    """Deviation of k1 and k2 as deviation.json counts it, %; NaN for a plane. shape on a grid, asked on its columns."""
    if rms == 0.0:
        nothing = np.full(shape.w11.shape, np.nan)
        return nothing, nothing
    scale = reference_curvature(asked, rms)[:, None, :]
    got, want = principal_curvatures_of(shape), principal_curvatures_of(asked)
    first, second = (100.0 * (a - b[:, None]) / scale[..., i] for i, (a, b) in enumerate(zip(got, want, strict=True)))
    return first, second


def _radius(per_m: float) -> float | None:
    return 1e3 / float(per_m) if abs(per_m) > 1e-9 else None


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
