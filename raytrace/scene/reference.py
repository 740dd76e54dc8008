"""The paper's scene: a picture of the road, standing as a plane behind the driver."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from raytrace.errors import SceneError
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
        _add_colours(trace.status, trace.points, trace.directions, self.z_mm, self._on_plane(),
                     NOTHING if self.beyond is None else self.beyond._on_plane(), BACKGROUND, BESIDE, sums, samples)

    def _on_plane(self) -> _OnPlane:
        _, x_max, _, y_max = self.bounds()
        rows, columns, _ = self.picture.shape
        return _OnPlane(self.picture.ravel(), columns, rows, x_max, y_max, columns / self.width_mm)

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
    for i in range(means.shape[0]):
        for c in range(3):
            shown[i, c] = np.uint8(np.rint(means[i, c]))
    return shown


class _OnPlane(NamedTuple):
    """A picture as the kernel takes it: its bytes, columns and rows, where its left and top are, mm, and elements a mm."""

    picture: NDArray[np.uint8]
    columns: int
    rows: int
    x_max: float
    y_max: float
    per_mm: float


NOTHING = _OnPlane(np.zeros(0, dtype=np.uint8), 1, 0, 0.0, 0.0, 1.0)


@njit(cache=True, error_model="numpy", forceinline=True, _nrt=False, no_cfunc_wrapper=True)
def _on(place, points, n, t, directions):
    """Column, row and whether they lie on a picture, of where ray n meets the plane; in elements from the left and the top."""
    column = (place.x_max - points[n, 0] - t * directions[n, 0]) * place.per_mm - 0.5  # the left is at the largest X
    row = (place.y_max - points[n, 1] - t * directions[n, 1]) * place.per_mm - 0.5
    return column, row, place.rows > 0 and -0.5 <= column <= place.columns - 0.5 and -0.5 <= row <= place.rows - 0.5


@njit(cache=True, error_model="numpy", forceinline=True, _nrt=False, no_cfunc_wrapper=True)
def _between(place, column, row):
    """The colour at a place between elements of a picture, linear between the nearest four."""
    picture, columns, rows = place.picture, place.columns, place.rows
    right, below = 3 * min(columns - 1, 1), 3 * columns * min(rows - 1, 1)  # from an element to the next ones
    column, row = min(max(column, 0.0), columns - 1.0), min(max(row, 0.0), rows - 1.0)
    i, j = min(int(row), max(rows - 2, 0)), min(int(column), max(columns - 2, 0))
    a, b = row - i, column - j
    m = np.int64(np.uint32(3 * (i * columns + j)))
    here, beneath, corner = (1.0 - a) * (1.0 - b), a * (1.0 - b), a * b
    across = (1.0 - a) * b
    return (here * picture[m] + across * picture[m + right]
            + beneath * picture[m + below] + corner * picture[m + below + right],
            here * picture[m + 1] + across * picture[m + right + 1]
            + beneath * picture[m + below + 1] + corner * picture[m + below + right + 1],
            here * picture[m + 2] + across * picture[m + right + 2]
            + beneath * picture[m + below + 2] + corner * picture[m + below + right + 2])


@njit(cache=True, nogil=True, error_model="numpy", _nrt=False, no_cfunc_wrapper=True)
def _add_colours(status, points, directions, z, inner, outer, background, beside, sums, samples):
    for pixel in range(sums.shape[0]):
        red = green = blue = 0.0
        for k in range(samples):
            n = np.int64(np.uint32(pixel * samples + k))  # not negative, and known not to be
            if status[n] != 0:
                red, green, blue = red + background[0], green + background[1], blue + background[2]
                continue
            t = (z - points[n, 2]) / directions[n, 2]
            lands = 0.0 < t < np.inf
            column, row, inside = _on(inner, points, n, t, directions)
            if lands and inside:
                r, g, b = _between(inner, column, row)
            else:
                column, row, inside = _on(outer, points, n, t, directions)
                if lands and inside:
                    r, g, b = _between(outer, column, row)
                else:
                    r, g, b = beside[0], beside[1], beside[2]
            red, green, blue = red + r, green + g, blue + b
        sums[pixel, 0] += red
        sums[pixel, 1] += green
        sums[pixel, 2] += blue


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
