"""The paper's scene: a picture of the road, standing as a plane behind the driver."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from raytrace.errors import SceneError
from raytrace.kernels.picture_plane import NOTHING, OnPlane, add_colours
from raytrace.pictures import PictureError, read_picture
from raytrace.rays import Trace

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

BUILT_IN = "road"
# The part of the plane that the built-in picture shows, (X_min, X_max, Y_min, Y_max), and that of the coarser one that
# continues it, mm, where the first is as wide and stands where the paper's scene has it.
ROAD_MM, BEYOND_MM = (-6800.0, 2200.0, -5400.0, 5400.0), (-9000.0, 3200.0, -6800.0, 6800.0)
# What lies beside the picture: dark, so that the mirror keeps its outline where it sees farther than the picture reaches.
BESIDE = np.array([52.0, 54.0, 58.0])
BACKGROUND = np.array([246.0, 246.0, 244.0])  # what lies beside the mirror


@dataclass(frozen=True, slots=True, eq=False)
class ReferencePlane:
    """A picture on the plane z = z_mm, as a rear-facing camera took it: top up, its right edge at −X.

    picture (h, w, 3) uint8, kept as it is: linear interpolation, reflectance 1, no tone mapping.
    width_mm across, about centre_mm (X, Y); square picture elements.
    beyond : a picture on the same plane, seen where rays land beside this one.
    """

    picture: Picture
    z_mm: float
    width_mm: float
    centre_mm: tuple[float, float]
    beyond: ReferencePlane | None = None

    @staticmethod
    def of_image(image: str | Path, picture: Picture, z_mm: float, width_mm: float,
                 centre_mm: tuple[float, float]) -> ReferencePlane:
        """The plane with `picture`, which `load_picture(image)` gave; the built-in one goes on beyond its edges, at its scale.

        Raises
        ------
        SceneError
            As `load_picture`.
        """
        return ReferencePlane(picture, z_mm, width_mm, centre_mm,
                              _continued(z_mm, width_mm, centre_mm) if str(image) == BUILT_IN else None)

    def bounds(self) -> tuple[float, float, float, float]:
        """(X_min, X_max, Y_min, Y_max), mm."""
        half_height = 0.5 * self.width_mm * self.picture.shape[0] / self.picture.shape[1]
        x, y = self.centre_mm
        return x - 0.5 * self.width_mm, x + 0.5 * self.width_mm, y - half_height, y + half_height

    def add_colours(self, trace: Trace, eye: Array, rays: Array, sums: Array, samples: int) -> None:
        """Add the colour each ray sees to `sums`, (n // samples, 3) float64: `samples` rays in a row make one sum.

        Rays that are not reflected see BACKGROUND, rays that land beside the picture, and what continues it, BESIDE.
        """
        add_colours(trace.status, trace.points, trace.directions, self.z_mm, self._on_plane(),
                    NOTHING if self.beyond is None else self.beyond._on_plane(), BACKGROUND, BESIDE, sums, samples)

    def _on_plane(self) -> OnPlane:
        _, x_max, _, y_max = self.bounds()
        return OnPlane.of(self.picture, x_max, y_max, self.picture.shape[1] / self.width_mm)

    def to_display(self, means: Array) -> Picture:
        """The nearest bytes."""
        return rounded(means)


def landed(points: Array, directions: Array, z_mm: float) -> Array:
    """Where rays from points along directions (n, 3) meet the plane z = z_mm, (n, 3); NaN for those that do not go there."""
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (z_mm - points[:, 2]) / directions[:, 2]
    result: Array = points + np.where(t > 0.0, t, np.nan)[:, None] * directions
    return result


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def rounded(means: Array) -> Picture:
    """Colours (n, 3), 0 to 255, as the nearest bytes."""
    shown = np.empty(means.shape, dtype=np.uint8)
    numbers, bytes_ = means.ravel(), shown.ravel()  # of the second, a view
    for i in range(numbers.size):
        bytes_[i] = np.int32(np.rint(numbers[i]))  # for which there is a vector instruction, as there is none to a byte
    return shown


def load_picture(image: str | Path) -> Picture:
    """Decode the built-in picture ("road") or a picture file to (h, w, 3) uint8, as `raytrace.pictures.read_picture`.

    Where the picture is transparent there is none: what lies beside it, BESIDE, is seen through it.

    Raises
    ------
    SceneError
        For a file that is missing, no picture, damaged, or larger than MAX_PIXELS (before decoding).
    """
    path: Any = _asset("road.jpg") if image == BUILT_IN else Path(image)
    try:
        with path.open("rb") as stream:
            return read_picture(stream).over(BESIDE)
    except FileNotFoundError:
        raise SceneError(f"{image}: no such picture (scene.image is \"road\" or a picture file)") from None
    except PictureError as error:
        raise SceneError(f"{image}: {error}") from None
    except OSError as error:
        raise SceneError(f"{image}: the picture cannot be read: {error}") from None


def _continued(z_mm: float, width_mm: float, centre_mm: tuple[float, float]) -> ReferencePlane:
    """The picture that continues the built-in one, at the scale and place of that."""
    scale = width_mm / (ROAD_MM[1] - ROAD_MM[0])
    x, y = (centre + 0.5 * scale * (BEYOND_MM[i] + BEYOND_MM[i + 1] - ROAD_MM[i] - ROAD_MM[i + 1])
            for centre, i in zip(centre_mm, (0, 2), strict=True))
    return ReferencePlane(_beyond(), z_mm, scale * (BEYOND_MM[1] - BEYOND_MM[0]), (x, y))


@cache
def _beyond() -> Picture:
    with _asset("road-beyond.jpg").open("rb") as stream:
        return read_picture(stream).colours


def _asset(name: str) -> Any:
    return resources.files("raytrace") / "scene" / "assets" / name
