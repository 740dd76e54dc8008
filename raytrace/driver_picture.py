"""The driver's picture of a scene in a mirror: a pinhole at the eye, the picture plane z = 0."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from raytrace.image import SAMPLES, Scene, photograph
from raytrace.scene.reference import BUILT_IN, Picture, ReferencePlane, load_picture
from raytrace.viewing.camera import Frame
from raytrace.viewing.view import View

PLANE_DISTANCE_MM = 8200.0  # of the reference plane behind the eye: Lee et al. (2014), section 3.2
PLANE_WIDTH_MM, PLANE_CENTRE_MM = 9000.0, (-2300.0, 0.0)  # of the built-in picture on it


@dataclass(frozen=True, slots=True, eq=False)
class DriverView:
    """What an eye sees in a mirror, in square pixels, row 0 at the top.

    Parameters
    ----------
    picture : (rows, columns, 3) uint8.
    frame : the part of the plane z = 0 that it shows.
    rays : how many rays had which status, by its name.
    """

    picture: Picture
    frame: Frame
    rays: dict[str, int]

    def save(self, path: str | Path) -> None:
        """Write it as PNG, or in the format that the path's ending names."""
        from PIL import Image

        Image.fromarray(self.picture).save(path)

    def __array__(self, dtype: np.dtype[np.generic] | None = None, copy: bool | None = None) -> NDArray[np.generic]:
        return np.array(self.picture, dtype=dtype, copy=copy)

    def __repr__(self) -> str:
        rows, columns, _ = self.picture.shape
        shown = self.rays.get("reflected", 0) / max(sum(self.rays.values()), 1)
        return f"DriverView({columns} × {rows} px of {self.frame.pixel:.3g} mm, {100.0 * shown:.0f} % of its rays reflected)"

    def _repr_png_(self) -> bytes:
        from PIL import Image

        stream = io.BytesIO()
        Image.fromarray(self.picture).save(stream, "PNG")
        return stream.getvalue()


def driver_view(view: View, scene: Scene | Picture | str | Path | None = None, width_px: int = 1280, samples: int = SAMPLES,
                progress: Callable[[float], None] | None = None) -> DriverView:
    """Render what the eye of a view sees in its mirror.

    Parameters
    ----------
    view : the mirror and the eye.
    scene : what lies behind: anything with the methods of `raytrace.image.Scene`, in the mirror's own coordinates; or a
        picture as a rear-facing camera took it, its file, or "road", which is the default: 9 m wide on a plane 8.2 m behind
        the eye.
    width_px : pixels across the frame, which is the mirror's box with 5 % of its width on every side.
    samples : rays a direction in the pixels that need more than one.
    progress : called with the share that is done; what it raises ends the work.

    Raises
    ------
    SceneError
        For a picture that cannot be read.
    """
    eye, frame = view.eye_in_mirror, Frame.around(view.box, width_px)
    on_plane = (float(eye[2]) + PLANE_DISTANCE_MM, PLANE_WIDTH_MM, PLANE_CENTRE_MM)
    if scene is None or isinstance(scene, str | Path):
        image = BUILT_IN if scene is None else scene
        scene = ReferencePlane.of_image(image, load_picture(image), *on_plane)
    if isinstance(scene, np.ndarray):
        scene = ReferencePlane(scene, *on_plane)
    picture, rays = photograph(view.reflector, frame.camera(eye), scene, progress, samples)
    return DriverView(picture, frame, rays)
