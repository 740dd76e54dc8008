"""The faces and solids of a kernel shape."""

from __future__ import annotations

from OCP.TopAbs import TopAbs_FACE, TopAbs_SOLID
from OCP.TopExp import TopExp_Explorer
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
