"""One whole picture as work to be timed: ours and Mitsuba's, one ray a pixel, from the same frame."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirror_studio.bench.tracers.case import Case
from mirror_studio.bench.tracers.mitsuba_mesh import mesh_of, use_for_pictures
from mirror_studio.bench.tracers.tracer import Work
from mirror_studio.viewing_setup import ViewingSetup
from raytrace.image import photograph
from raytrace.scene.reference import BESIDE, ReferencePlane, load_picture
from raytrace.scene.world import TriangleWorld
from raytrace.viewing.camera import Frame

FRAME_WIDTH_MM = 210.0  # inside the outline of progressive-c: every ray of a picture is reflected
SKY_ROWS = 256  # of Mitsuba's picture of the sky, from the zenith to the nadir


def frame_of(width_px: int, height_px: int) -> Frame:
    """The picture over the middle of the mirror."""
    pixel = FRAME_WIDTH_MM / width_px
    return Frame(-0.5 * FRAME_WIDTH_MM, 0.5 * pixel * height_px, pixel, width_px, height_px)


def reference_plane(case: Case) -> ReferencePlane:
    """The built-in picture where the specification has it."""
    spec = case.mirror.spec
    return ViewingSetup.of(spec, case.mirror.box).scene(load_picture(spec.scene.image), spec)


def ours(case: Case, scene: ReferencePlane | TriangleWorld, frame: Frame) -> Work:
    """The driver's view, (rows, columns, 3) uint8."""
    return lambda: photograph(case.reflector, frame.camera(case.eye), scene, samples=1)[0]


def mitsuba(case: Case, scene: ReferencePlane | TriangleWorld, frame: Frame, triangles: int,
            variant: str) -> Work:
    """The same by Mitsuba's direct integrator, values as ours but float32.

    A perfect mirror as a mesh with smooth normals, and what it shows as area emitters.

    Raises: AbsentError where the variant does not work here.
    """
    mi = use_for_pictures(variant)
    mirror = mesh_of(mi, case.mesh(triangles), props=_mirror_properties(mi))
    shown = _plane(mi, scene) if isinstance(scene, ReferencePlane) else _world(mi, scene)
    loaded = mi.load_dict({"type": "scene", "mirror": mirror, "sensor": _sensor(mi, case, frame), **shown,
                           "integrator": {"type": "direct", "emitter_samples": 0, "bsdf_samples": 1}})
    integrator, sensor = loaded.integrator(), loaded.sensors()[0]

    def work() -> NDArray[Any]:
        return 255.0 * np.array(integrator.render(loaded, sensor, seed=0, spp=1))

    return work


def _mirror_properties(mi: Any) -> Any:
    properties = mi.Properties()
    properties["mirror_bsdf"] = mi.load_dict({"type": "conductor", "material": "none"})
    return properties


def _sensor(mi: Any, case: Case, frame: Frame) -> dict[str, Any]:
    """A pinhole that looks along −z; the frame's centre lies beside its axis.

    Mitsuba counts that offset in pictures' widths and heights, to the left and up.
    """
    width, height = frame.pixel * frame.columns, frame.pixel * frame.rows
    x, y, z = case.eye.tolist()
    return {"type": "perspective", "fov_axis": "x", "fov": math.degrees(2.0 * math.atan(0.5 * width / z)),
            "principal_point_offset_x": 0.5 - (x - frame.left) / width,
            "principal_point_offset_y": 0.5 - (frame.top - y) / height,
            "to_world": mi.ScalarTransform4f().look_at([x, y, z], [x, y, 0.0], [0.0, 1.0, 0.0]),
            "film": {"type": "hdrfilm", "width": frame.columns, "height": frame.rows, "pixel_format": "rgb",
                     "component_format": "float32", "rfilter": {"type": "box"}},
            "sampler": {"type": "independent", "sample_count": 1}}


def _plane(mi: Any, scene: ReferencePlane) -> dict[str, Any]:
    x_min, x_max, y_min, y_max = scene.bounds()
    place = (mi.ScalarTransform4f().translate([0.5 * (x_min + x_max), 0.5 * (y_min + y_max), scene.z_mm])
             .rotate([0.0, 1.0, 0.0], 180.0).scale([0.5 * (x_max - x_min), 0.5 * (y_max - y_min), 1.0]))
    picture = {"type": "bitmap", "raw": True, "bitmap": mi.Bitmap(scene.picture[::-1].astype(np.float32) / 255.0)}
    return {"picture": {"type": "rectangle", "to_world": place, "emitter": {"type": "area", "radiance": picture}},
            "beside": {"type": "constant", "radiance": {"type": "rgb", "value": (BESIDE / 255.0).tolist()}}}


def _world(mi: Any, world: TriangleWorld) -> dict[str, Any]:
    properties = mi.Properties()
    properties["emitter"] = mi.load_dict({"type": "area", "radiance": {"type": "mesh_attribute", "name": "face_color"}})
    made = mi.Mesh("world", len(world.vertices), len(world.faces), props=properties)
    made.add_attribute("face_color", 3, np.ravel(world.shown[:-2] / 255.0).astype(np.float32))
    parameters = mi.traverse(made)
    parameters["vertex_positions"] = np.ravel(world.vertices).astype(np.float32)
    parameters["faces"] = np.ravel(world.faces).astype(np.uint32)
    parameters.update()
    up = np.maximum(np.cos(np.pi * (np.arange(SKY_ROWS) + 0.5) / SKY_ROWS), 0.0)[:, None]
    sky = (1.0 - up) * world.shown[-2] + up * world.shown[-1]
    rows = np.repeat(sky[:, None] / 255.0, 2, axis=1).astype(np.float32)
    return {"world": made, "sky": {"type": "envmap", "bitmap": mi.Bitmap(rows)}}
