"""Patches in mm in, a GLB file out: metres, Y up, the front end towards +Z, as glTF 2.0 has it.

A file holds one mesh with a primitive a material: POSITION and NORMAL, TEXCOORD_0 on the number plates, and _SKY, a float
a vertex: the share of the hemisphere above the surface, weighted with the cosine, that sees past the body itself (the
ground hides nothing). The origin lies on the ground, on the median plane, at the front end; x rearward, y right and z up of
a vehicle are −Z, −X and Y in the file. The mesh's extras hold the shadow that the body casts on the ground under an
overcast sky, in metres, x rearward and y to the right, the x index slowest:

    "ground": {"x0": …, "dx": …, "nx": …, "y0": …, "dy": …, "ny": …, "sky": [nx·ny shares of the sky, 1 outside]}

The same bytes come out every time.
Source: Khronos Group, glTF 2.0 Specification, 2021.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from raytrace.embree import TriangleScene
from raytrace.scene.visibility import Contact, contact, vertex_openness

from .materials import MATERIALS
from .plate import picture
from .tessellate import Patch, merged

MM = 1e-3
SIDE = 16  # 256 directions a place: baked once, they can be many
GLTF_FROM_VEHICLE = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
FLOAT, SHORT, INT = 5126, 5123, 5125
VERTICES, INDICES = 34962, 34963


def write_glb(path: Path, patches: Sequence[Patch]) -> None:
    """Write the patches, with what each vertex and the ground see of the sky."""
    parts = merged(patches)
    points = np.concatenate([part.points for part in parts])
    normals = np.concatenate([part.normals for part in parts])
    offsets = np.cumsum([0, *(len(part.points) for part in parts)])
    faces = np.concatenate([part.faces + offset for part, offset in zip(parts, offsets, strict=False)])
    scene = TriangleScene(points, faces)
    shares = vertex_openness(scene, points, normals, faces, SIDE)
    ground = contact(scene, points, SIDE)
    assert ground is not None  # none of them is as large as that
    path.write_bytes(_glb(path.stem, parts, [shares[a:b] for a, b in pairwise(offsets)], ground))


class _Buffer:
    """The binary chunk as it grows, with the views into it and their accessors."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, int]] = []
        self.accessors: list[dict[str, object]] = []

    def view(self, data: bytes, target: int | None = None) -> int:
        self.data += bytes(-len(self.data) % 4)
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)}
        self.views.append(view if target is None else {**view, "target": target})
        self.data += data
        return len(self.views) - 1

    def accessor(self, values: NDArray[np.float64], kind: str, bounds: bool = False) -> int:
        """A float32 array a vertex."""
        array = np.ascontiguousarray(values, dtype="<f4")
        entry: dict[str, object] = {"bufferView": self.view(array.tobytes(), VERTICES), "componentType": FLOAT,
                                    "count": len(array), "type": kind}
        if bounds:
            entry |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        self.accessors.append(entry)
        return len(self.accessors) - 1

    def indices(self, faces: NDArray[np.int64]) -> int:
        small = int(faces.max()) < 0xFFFF
        array = np.ascontiguousarray(faces.ravel(), dtype="<u2" if small else "<u4")
        self.accessors.append({"bufferView": self.view(array.tobytes(), INDICES), "componentType": SHORT if small else INT,
                               "count": len(array), "type": "SCALAR"})
        return len(self.accessors) - 1


def _glb(name: str, parts: Sequence[Patch], shares: Sequence[NDArray[np.float64]], ground: Contact) -> bytes:
    buffer = _Buffer()
    primitives = []
    for number, (part, share) in enumerate(zip(parts, shares, strict=True)):
        attributes = {"POSITION": buffer.accessor(MM * part.points @ GLTF_FROM_VEHICLE.T, "VEC3", bounds=True),
                      "NORMAL": buffer.accessor(part.normals @ GLTF_FROM_VEHICLE.T, "VEC3")}
        if part.uv is not None:
            attributes["TEXCOORD_0"] = buffer.accessor(part.uv, "VEC2")
        attributes["_SKY"] = buffer.accessor(share, "SCALAR")
        primitives.append({"attributes": attributes, "indices": buffer.indices(part.faces), "material": number, "mode": 4})
    textured = [number for number, part in enumerate(parts) if part.uv is not None]
    document: dict[str, object] = {
        "asset": {"version": "2.0", "generator": "scripts/make_vehicles.py"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": name}],
        "meshes": [{"name": name, "primitives": primitives, "extras": {"ground": _extras(ground)}}],
        "materials": [_material(part.material, number in textured) for number, part in enumerate(parts)]}
    if textured:
        document |= {"textures": [{"source": 0}], "images": [{"bufferView": buffer.view(picture()), "mimeType": "image/png"}]}
    document |= {"accessors": buffer.accessors, "bufferViews": buffer.views}
    data = bytes(buffer.data) + bytes(-len(buffer.data) % 4)
    document["buffers"] = [{"byteLength": len(data)}]
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(data), 0x004E4942) + data
    return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks


def _material(name: str, textured: bool) -> dict[str, object]:
    material = MATERIALS[name]
    surface: dict[str, object] = {"baseColorFactor": [*material.colour, 1.0], "metallicFactor": material.metallic,
                                  "roughnessFactor": material.roughness}
    if textured:
        surface["baseColorTexture"] = {"index": 0}
    return {"name": name, "pbrMetallicRoughness": surface}


def _extras(ground: Contact) -> dict[str, object]:
    nx, ny = ground.sky.shape
    (x0, y0), step = MM * ground.origin, round(MM * float(ground.along[0]), 6)
    return {"x0": round(x0, 4), "dx": step, "nx": nx, "y0": round(y0, 4), "dy": step, "ny": ny,
            "sky": [round(float(value), 2) for value in ground.sky.ravel()]}
