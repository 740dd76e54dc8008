"""Where a mirror stands in the coordinates of its file, and the rigid motion that takes these to mirror coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace.errors import TraceError

Array = NDArray[np.float64]
Source = Literal["file", "face", "stated"]
Hand = Literal["left", "right"]

MIN_UPRIGHT = 1e-3  # sine of the angle between `up` and the normal: below it `up` says nothing
LARGEST_MM = 1e9  # of an origin that is stated: farther away no digit is left for the mirror


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """The mirror's frame in the coordinates of its file: p_mirror = R·(p_file − o), the rows of R being ±up × n, up and n.

    origin_mm (3,) : o, the point of the mirror surface that becomes the origin.   normal (3,) : n, unit, towards the driver.
    up (3,) : unit, across the normal.   source : who says so: the file (it is in mirror coordinates), the face that reflects,
    or the user.   hand : of the mirror, where its file says so. Mirror coordinates are those of the left-hand mirror: a
    right-hand one is reflected in x = 0, so that its measures are those of the left-hand one it was designed as.
    """

    origin_mm: Array
    normal: Array
    up: Array
    source: Source = "stated"
    hand: Hand = "left"

    @staticmethod
    def of(origin_mm: ArrayLike, normal: ArrayLike, up: ArrayLike, source: Source = "stated") -> Placement:
        """The placement with a normal and an up of any length; of `up` what lies across the normal counts.

        Raises
        ------
        TraceError
            For vectors that are not finite or zero, or where `up` runs along the normal.
        """
        origin, n, upright = (np.asarray(each, dtype=np.float64) for each in (origin_mm, normal, up))
        for name, vector in (("origin", origin), ("normal", n), ("up", upright)):
            if vector.shape != (3,) or not np.isfinite(vector).all():
                raise TraceError(f"place: {name} must be three finite numbers, not {vector.tolist()}")
        if np.abs(origin).max() > LARGEST_MM:
            raise TraceError(f"place: origin {origin.tolist()} mm is farther away than {LARGEST_MM:g} mm")
        for name, vector in (("normal", n), ("up", upright)):
            if not np.abs(vector).max() > 0.0:
                raise TraceError(f"place: {name} is zero: it must be a direction")
        n = _unit(n)
        across = _unit(upright) - (_unit(upright) @ n) * n
        if np.linalg.norm(across) < MIN_UPRIGHT:
            raise TraceError(f"place: up {upright.tolist()} runs along the normal {np.round(n, 6).tolist()}: state a direction "
                             "that points up as the driver looks at the mirror")
        across = _unit(across)
        return Placement(origin, n, _unit(across - (across @ n) * n), source)

    @staticmethod
    def identity(source: Source = "file", hand: Hand = "left") -> Placement:
        """Of a file in mirror coordinates."""
        return Placement(np.zeros(3), np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0]), source, hand)

    @property
    def rotation(self) -> Array:
        """R (3, 3): directions of the file to those of the mirror; its determinant is −1 for a right-hand mirror."""
        across = np.cross(self.up, self.normal)
        return np.stack([across if self.hand == "left" else -across, self.up, self.normal])

    @property
    def is_identity(self) -> bool:
        """Whether nothing moves."""
        return bool((self.origin_mm == 0.0).all() and (self.rotation == np.eye(3)).all())

    def to_mirror(self, points: Array) -> Array:
        """Points (…, 3) of the file in mirror coordinates, mm."""
        result: Array = (points - self.origin_mm) @ self.rotation.T
        return result

    def to_file(self, points: Array) -> Array:
        """Points (…, 3) of mirror coordinates in the file's, mm."""
        result: Array = points @ self.rotation + self.origin_mm
        return result

    def __str__(self) -> str:
        origin = ", ".join(f"{round(float(v), 6) + 0.0:.9g}" for v in self.origin_mm)
        normal, up = (", ".join(f"{round(float(v), 6) + 0.0:g}" for v in vector) for vector in (self.normal, self.up))
        said = {"file": "the file is in mirror coordinates", "face": "found from the face", "stated": "as stated"}[self.source]
        hand = "" if self.hand == "left" else ("; a right-hand mirror by its file, taken as the left-hand one that it is the "
                                               "reflection of")
        return f"origin ({origin}) mm, normal ({normal}), up ({up}): {said}{hand}"


def _unit(vector: Array) -> Array:
    scaled = vector / np.abs(vector).max()
    result: Array = scaled / np.linalg.norm(scaled)
    return result
