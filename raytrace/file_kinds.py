"""The ending of a file in, whether a kernel reads it and what to do with one that nothing here reads out."""

from __future__ import annotations

CAD_KINDS = (".step", ".stp", ".iges", ".igs", ".brep", ".brp")

_TO_STEP = "save it as STEP (AP242 or AP214)"
_TO_MESH = "save it as PLY, OBJ or GLB"
_MADE_IN = {".3dm": "Rhino", ".sldprt": "SolidWorks", ".sldasm": "SolidWorks", ".catpart": "CATIA", ".catproduct": "CATIA",
            ".prt": "NX or Creo", ".ipt": "Inventor", ".iam": "Inventor", ".fcstd": "FreeCAD"}
_CONVERSIONS = {
    **{kind: f"Open it in {program} and {_TO_STEP}" for kind, program in _MADE_IN.items()},
    **dict.fromkeys((".x_t", ".x_b", ".sat", ".sab", ".jt"), f"Open it where it was made and {_TO_STEP}"),
    **dict.fromkeys((".dae", ".fbx", ".blend", ".usd", ".usdz", ".abc"), f"Open it in Blender and {_TO_MESH}"),
    ".stpz": "Unpack it: it is a packed STEP file", ".stpx": f"Open it where it was made and {_TO_STEP}",
    ".dxf": "It is a drawing, which serves as an outline; save the surface as STEP or as a mesh",
}


def conversion(kind: str) -> str:
    """What to do with a file of a kind that nothing here reads, to be put behind a message; "" where we know nothing."""
    return f". {_CONVERSIONS[kind]}" if kind in _CONVERSIONS else ""
