"""What an eye sees past a mirror, kept from draft to draft: it changes with the eye, not with the mirror."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from raytrace.scene.lit_world import LitWorld
from raytrace.viewing.camera import Camera

Array = NDArray[np.float64]

MARGIN = 0.08  # of a picture's width and height, kept beyond each of its sides: another aim turns the camera a little
COARSEST, FINEST = 1.25, 0.8  # pixels of another picture beside the kept ones
MAX_EYES = 4  # both of two pages


@dataclass(frozen=True, eq=False)
class Backdrop:
    """The radiance that one eye sees in a world, on a grid of directions; in between that of the nearest.

    Attributes
    ----------
    world, eye : what is seen, and from where, (3,), mm.
    to_grid : (3, 3), takes a direction (row) to column·t, row·t and t of the grid.
    seen : (rows, columns, 3), kcd/m² a channel.
    pixel : of the grid, radians.
    """

    world: LitWorld
    eye: Array
    to_grid: Array
    seen: Array
    pixel: float

    @staticmethod
    def around(world: LitWorld, camera: Camera, pixel: float) -> Backdrop:
        """With MARGIN around what a camera shows; the camera in the world's frame, its pixel in radians."""
        beyond = [int(np.ceil(MARGIN * size)) for size in (camera.columns, camera.rows)]
        wide = replace(camera, base=camera.base - beyond[0] * camera.across - beyond[1] * camera.down,
                       columns=camera.columns + 2 * beyond[0], rows=camera.rows + 2 * beyond[1])
        row, column = 0.5 + np.indices((wide.rows, wide.columns))
        directions = wide.rays_through(column, row).reshape(-1, 3)
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        seen = world.radiance(wide.eye, directions, 0.5 * pixel).reshape(wide.rows, wide.columns, 3)
        return Backdrop(world, wide.eye, np.linalg.inv(np.stack([wide.across, wide.down, wide.base])), seen, pixel)

    def holds(self, world: LitWorld, camera: Camera, pixel: float) -> bool:
        """Whether all that a camera shows is here, about as fine."""
        ends = np.array([[0, 0], [0, camera.rows], [camera.columns, 0], [camera.columns, camera.rows]])
        columns, rows = self._places(camera.rays_through(ends[:, 0], ends[:, 1]))
        return (world is self.world and np.array_equal(camera.eye, self.eye) and FINEST <= pixel / self.pixel <= COARSEST
                and bool(min(columns.min(), rows.min()) >= 0.0 and columns.max() <= self.seen.shape[1]
                         and rows.max() <= self.seen.shape[0]))

    def radiance(self, origins: Array, directions: Array, spread: Array) -> Array:
        """As `LitWorld.radiance`, of rays from the eye that `holds` was asked for."""
        columns, rows = self._places(directions)
        last_row, last_column = self.seen.shape[0] - 1, self.seen.shape[1] - 1
        return self.seen[np.clip(rows.astype(np.intp), 0, last_row), np.clip(columns.astype(np.intp), 0, last_column)]

    def _places(self, directions: Array) -> tuple[Array, Array]:
        at = directions @ self.to_grid
        return at[:, 0] / at[:, 2], at[:, 1] / at[:, 2]


class Backdrops:
    """The backdrops of the eyes that drafts were last made for.

    An eye has none before its second draft: while an eye itself is moved, each would be made for one draft.
    """

    def __init__(self) -> None:
        self._kept: dict[bytes, Backdrop | None] = {}

    def of(self, world: LitWorld, camera: Camera, pixel: float) -> Backdrop | None:
        """That of a camera's eye, made anew where the one that is kept does not hold what the camera shows."""
        key = camera.eye.tobytes()
        if key not in self._kept:
            if len(self._kept) >= MAX_EYES:
                self._kept.pop(next(iter(self._kept)), None)
            self._kept[key] = None
            return None
        found = self._kept[key]
        if found is None or not found.holds(world, camera, pixel):
            found = self._kept[key] = Backdrop.around(world, camera, pixel)
        return found
