"""The faces, solids and free curves of a kernel shape."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from OCP.BRepAdaptor import BRepAdaptor_Curve
from OCP.TopAbs import TopAbs_EDGE, TopAbs_FACE, TopAbs_SOLID
from OCP.TopExp import TopExp_Explorer
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS, TopoDS_Face, TopoDS_Shape, TopoDS_Solid


def faces_of(shape: TopoDS_Shape) -> list[TopoDS_Face]:
    """Every face of a shape."""
    explorer = TopExp_Explorer(shape, TopAbs_FACE)
    found = []
    while explorer.More():
        found.append(TopoDS.Face_s(explorer.Current()))
        explorer.Next()
    return found


def solids_of(shape: TopoDS_Shape) -> list[TopoDS_Solid]:
    """Every solid of a shape."""
    explorer = TopExp_Explorer(shape, TopAbs_SOLID)
    found = []
    while explorer.More():
        found.append(TopoDS.Solid_s(explorer.Current()))
        explorer.Next()
    return found


def anywhere(shape: TopoDS_Shape) -> int:
    """The same for a shape wherever it is placed and however it is turned. Shapes themselves are equal to none in a set."""
    return hash(shape.Located(TopLoc_Location()))


def free_curves_of(shape: TopoDS_Shape, count: int) -> list[NDArray[np.float64]]:
    """Points (count, 3), mm, from end to end of every edge that bounds no face."""
    explorer = TopExp_Explorer(shape, TopAbs_EDGE, TopAbs_FACE)
    found = []
    while explorer.More():
        curve = BRepAdaptor_Curve(TopoDS.Edge_s(explorer.Current()))
        at = np.linspace(curve.FirstParameter(), curve.LastParameter(), count)
        points = (curve.Value(float(t)) for t in at)
        found.append(np.array([[point.X(), point.Y(), point.Z()] for point in points]))
        explorer.Next()
    return found
