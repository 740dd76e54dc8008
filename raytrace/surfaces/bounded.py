"""What a face S(u, v) cut from a sheet answers beside what every reflecting surface does."""

from __future__ import annotations

from abc import abstractmethod
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace.rays import Mask
from raytrace.surfaces.base import CELLS, EDGE_INSET, AreaSamples, OpticalSurface
from raytrace.surfaces.trimming import Trimming

Array = NDArray[np.float64]

Face = TypeVar("Face", bound="BoundedFace")


class BoundedFace(OpticalSurface):
    """A face S(u, v) cut from a sheet, whose rim is known piece by piece in its parameters."""

    @abstractmethod
    def evaluate(self, u: ArrayLike, v: ArrayLike) -> Array:
        """Points (…, 3), mm."""

    @property
    @abstractmethod
    def parameter_limits(self) -> tuple[Array, Array]:
        """The least and the greatest (u, v) at which rays meet the surface, (2,) each."""

    sign: float
    one_sided: bool

    @property
    @abstractmethod
    def trimming(self) -> Trimming:
        """Its loops as the kernels take them."""

    @property
    def bounding_faces(self) -> tuple[BoundedFace, ...]:
        """Itself."""
        return (self,)

    @property
    def extends(self) -> bool:
        """It does: its sheet is known."""
        return True

    @property
    def edge_inset(self) -> float:
        """EDGE_INSET: the sheet goes on beyond."""
        return EDGE_INSET

    @property
    def looks_outward(self) -> bool:
        """Whether it is one-sided."""
        return self.one_sided

    @abstractmethod
    def two_sided(self) -> BoundedFace:
        """The same face, reflecting on both sides."""

    def area_samples(self) -> AreaSamples:
        """Middles of the cells of a grid in (u, v) that lie inside the loops, or of all where none does."""
        u_min, u_max, v_min, v_max = self.trimming.box
        u, v = np.linspace(u_min, u_max, CELLS + 1), np.linspace(v_min, v_max, CELLS + 1)
        s = self.evaluate(u[:, None], v[None, :])
        at_u, at_v = (each.ravel() for each in np.meshgrid(0.5 * (u[1:] + u[:-1]), 0.5 * (v[1:] + v[:-1]), indexing="ij"))
        areas = 0.5 * self.sign * np.cross(s[1:, 1:] - s[:-1, :-1], s[:-1, 1:] - s[1:, :-1]).reshape(-1, 3)
        inside = self.trimming.contains(at_u, at_v)
        if not inside.any():
            inside[:] = True
        return AreaSamples(self.evaluate(at_u[inside], at_v[inside]), areas[inside], np.zeros(int(inside.sum()), dtype=np.intp))

    def one_side(self, samples: AreaSamples, side: Mask) -> tuple[OpticalSurface, Array]:
        """All of it, with the points of its rim."""
        return self.two_sided(), np.concatenate([*(curve.points for curve in self.rim), samples.points[side]])


def with_trimming_of(face: BoundedFace, again: Face) -> Face:
    """The second face, with what the first has made of the loops that both have: sorting them takes as long as reading."""
    if "trimming" in vars(face):
        vars(again)["trimming"] = face.trimming
    return again
