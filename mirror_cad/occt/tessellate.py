"""Triangulation of shapes, and STL files read by the kernel."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.BRepTools import BRepTools
from OCP.IMeshTools import IMeshTools_MeshAlgoType, IMeshTools_Parameters
from OCP.Message import Message, Message_Printer
from OCP.RWStl import RWStl
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS_Face, TopoDS_Shape

from mirror_cad.errors import FileError
from mirror_cad.mesh import SurfaceMesh

# The chordal deflection alone decides: an angular limit this wide never adds a triangle on a mirror.
ANGULAR_DEFLECTION_RAD = 1.0


def triangulate(shape: TopoDS_Shape, deflection_mm: float, straight: bool = False) -> None:
    """Mesh a shape in place by the kernel, which takes the deflection, an absolute length, as advice.

    For any shape; a mirror's own plate has `plate_mesh`, which keeps to it. Delabella is many times faster than the
    kernel's default mesher at deflections below 0.01 mm, but does not always come to an end on a surface that is straight
    in one direction: `straight` takes the default one.
    """
    BRepTools.Clean_s(shape)
    parameters = IMeshTools_Parameters()
    parameters.Deflection = deflection_mm
    parameters.Angle = ANGULAR_DEFLECTION_RAD
    parameters.Relative = False
    kinds = IMeshTools_MeshAlgoType
    parameters.MeshAlgo = kinds.IMeshTools_MeshAlgoType_Watson if straight else kinds.IMeshTools_MeshAlgoType_Delabella
    BRepMesh_IncrementalMesh(shape, parameters)


def face_mesh(face: TopoDS_Face) -> SurfaceMesh:
    """The triangles that `triangulate` put on a face."""
    location = TopLoc_Location()
    triangulation = BRep_Tool.Triangulation_s(face, location)
    if triangulation is None:
        raise FileError("the kernel could not triangulate a face: is its boundary closed?")
    transform = location.Transformation()
    nodes = [triangulation.Node(i).Transformed(transform) for i in range(1, triangulation.NbNodes() + 1)]
    faces = np.array([triangulation.Triangle(i).Get() for i in range(1, triangulation.NbTriangles() + 1)], dtype=np.int32)
    faces -= 1
    if face.Orientation().name == "TopAbs_REVERSED":
        faces = faces[:, ::-1].copy()
    return SurfaceMesh(np.array([(p.X(), p.Y(), p.Z()) for p in nodes]), faces)


def read_stl_by_kernel(path: Path) -> SurfaceMesh:
    """The triangles of an STL file. Raises: FileError for one that holds none, or corners that are not finite."""
    # What the kernel has to say of a damaged file would go to the standard output, which belongs to results.
    Message.DefaultMessenger_s().RemovePrinters(Message_Printer.get_type_descriptor_s())
    triangulation = RWStl.ReadFile_s(str(path))
    if triangulation is None or triangulation.NbTriangles() == 0:
        raise FileError(f"{path}: not an STL file with triangles in it")
    nodes = [triangulation.Node(i) for i in range(1, triangulation.NbNodes() + 1)]
    faces = np.array([triangulation.Triangle(i).Get() for i in range(1, triangulation.NbTriangles() + 1)], dtype=np.int32)
    vertices = np.array([(p.X(), p.Y(), p.Z()) for p in nodes])
    if not np.isfinite(vertices).all():
        raise FileError(f"{path}: a facet has a corner that is not finite")
    return SurfaceMesh(vertices, faces - 1)
