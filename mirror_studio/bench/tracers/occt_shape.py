"""The kernel's own intersection of a line with a face, a call a ray: slow, in float64, and an oracle."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace
from OCP.gp import gp_Dir, gp_Lin, gp_Pnt, gp_Vec
from OCP.IntCurvesFace import IntCurvesFace_ShapeIntersector

from mirror_cad.occt.convert import to_geom_surface
from mirror_studio.bench.tracers.case import Case, Rays
from mirror_studio.bench.tracers.tracer import Tracer, Work

ORACLE = "OCCT ShapeIntersector"
TOLERANCE_MM = 1e-7  # the kernel's own smallest
MOST = 1000  # rays: it finds some ten thousand a second
REACH_MM = 1e5


def tracers(case: Case) -> Iterator[Tracer]:
    """The untrimmed face."""
    geometry = to_geom_surface(case.mirror.surface)
    finder = IntCurvesFace_ShapeIntersector()
    finder.Load(BRepBuilderAPI_MakeFace(geometry, TOLERANCE_MM).Face(), TOLERANCE_MM)

    def prepare(rays: Rays) -> Work:
        eye = gp_Pnt(*rays.origins.tolist())
        point, along_u, along_v = gp_Pnt(), gp_Vec(), gp_Vec()

        def work() -> NDArray[np.float64]:
            out = np.full(rays.directions.shape, np.nan)
            for i, d in enumerate(rays.directions):
                finder.PerformNearest(gp_Lin(eye, gp_Dir(*d.tolist())), 0.0, REACH_MM)
                if finder.NbPnt() == 0:
                    continue
                geometry.D1(finder.UParameter(1), finder.VParameter(1), point, along_u, along_v)
                normal = along_u.Crossed(along_v).Normalized()
                n = np.array([normal.X(), normal.Y(), normal.Z()])
                out[i] = d - 2.0 * (d @ n) * n
            return out

        return work

    yield Tracer(ORACLE, prepare, MOST)
