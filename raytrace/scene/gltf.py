"""A glTF 2.0 file in, its triangles with normals, texture coordinates and materials out.

Read here and not by trimesh, which rounds base colours to 1/255 of linear light, a fifth of a dark tyre's, and leaves out
pictures that are missing without a word.
Source: The Khronos Group, glTF 2.0 specification.
"""

from __future__ import annotations

import base64
import binascii
import io
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import FileError
from raytrace.scene.materials import Colour, Material, linear
from raytrace.scene.parts import Part

Array = NDArray[np.float64]
Json = dict[str, Any]

COMPONENTS = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
TRIANGLES, STRIP, FAN = 4, 5, 6
# What a file may ask for that changes nothing here, or is read as any other accessor.
HARMLESS = {"KHR_mesh_quantization", "KHR_materials_unlit", "KHR_materials_ior", "KHR_materials_specular",
            "KHR_materials_clearcoat", "KHR_materials_transmission", "KHR_materials_emissive_strength", "KHR_lights_punctual"}
MAX_DEPTH = 100  # of the tree of nodes


@dataclass
class _File:
    """The parts of an opened file. Missing and impossible entries become FileError by `read_gltf`."""

    path: Path
    tree: Json
    binary: bytes
    buffers: dict[int, bytes] = field(default_factory=dict)
    pictures: dict[int, NDArray[np.uint8]] = field(default_factory=dict)

    def fail(self, message: str) -> NoReturn:
        raise FileError(f"{self.path}: {message}")


def read_gltf(path: Path, load_picture: Callable[[bytes, str], NDArray[np.uint8]]) -> tuple[list[Part], Json | None]:
    """The triangles of the file's scene, in metres with y up, one part a primitive, and the "ground" of its extras.

    load_picture : bytes and the picture's name → (h, w, 3) uint8.
    Raises: FileError for a file that is no glTF 2.0, cut short, or needs what is not read here; for pictures and buffers
    that are missing.
    """
    file = _opened(path)
    try:
        needs = set(file.tree.get("extensionsRequired", [])) - HARMLESS
        if needs:
            file.fail(f"needs the glTF extension {', '.join(sorted(needs))}, which is not read: export without compression "
                      "and without it")
        materials = [_material(file, entry, load_picture) for entry in file.tree.get("materials", [])]
        parts = [part for root in _roots(file.tree) for part in _node(file, root, np.eye(4), materials, 0)]
        return parts, _ground(file.tree)
    except (KeyError, IndexError, TypeError, ValueError, AttributeError) as error:
        raise FileError(f"{path}: not a readable glTF file ({type(error).__name__}: {error})") from None


def _opened(path: Path) -> _File:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FileError(f"{path}: cannot be read: {error.strerror or error}") from None
    binary = b""
    if data[:4] == b"glTF":
        version, length = (int(v) for v in np.frombuffer(data[4:12].ljust(8, b"\0"), dtype="<u4"))
        if version != 2:
            raise FileError(f"{path}: glTF {version}; 2 is read")
        if len(data) < length:
            raise FileError(f"{path}: holds {len(data)} of the {length} bytes that its header names: is it cut short?")
        chunks: dict[bytes, bytes] = {}
        at = 12
        while at + 8 <= length:
            size = int.from_bytes(data[at:at + 4], "little")
            chunks.setdefault(data[at + 4:at + 8], data[at + 8:at + 8 + size])
            at += 8 + size
        data, binary = chunks.get(b"JSON", b""), chunks.get(b"BIN\0", b"")
    try:
        tree = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise FileError(f"{path}: not a readable glTF file ({error})") from None
    asset = tree.get("asset") if isinstance(tree, dict) else None
    if not isinstance(asset, dict) or not str(asset.get("version", "")).startswith("2"):
        raise FileError(f"{path}: not a glTF 2 file (asset.version)")
    return _File(path, tree, binary)


def _roots(tree: Json) -> list[int]:
    scenes = tree.get("scenes", [])
    if scenes:
        return list(scenes[tree.get("scene", 0)].get("nodes", []))
    nodes = tree.get("nodes", [])
    below = {child for node in nodes for child in node.get("children", [])}
    return [k for k in range(len(nodes)) if k not in below]


def _node(file: _File, index: int, above: Array, materials: list[Material], depth: int) -> Iterator[Part]:
    if depth > MAX_DEPTH:
        file.fail("its nodes hang on themselves, or more than a hundred deep")
    node = file.tree["nodes"][index]
    matrix = above @ _transform(node)
    if "mesh" in node:
        for primitive in file.tree["meshes"][node["mesh"]]["primitives"]:
            part = _primitive(file, primitive, matrix, materials)
            if part is not None:
                yield part
    for child in node.get("children", []):
        yield from _node(file, child, matrix, materials, depth + 1)


def _transform(node: Json) -> Array:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    x, y, z, w = np.array(node.get("rotation", [0.0, 0.0, 0.0, 1.0]), dtype=np.float64)
    rotation = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                         [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                         [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])
    result = np.eye(4)
    result[:3, :3] = rotation * np.array(node.get("scale", [1.0, 1.0, 1.0]), dtype=np.float64)
    result[:3, 3] = node.get("translation", [0.0, 0.0, 0.0])
    return result


def _primitive(file: _File, primitive: Json, matrix: Array, materials: list[Material]) -> Part | None:
    mode, attributes = primitive.get("mode", TRIANGLES), primitive["attributes"]
    if mode not in (TRIANGLES, STRIP, FAN) or "POSITION" not in attributes:
        return None
    vertices = _accessor(file, attributes["POSITION"])
    corners = (_accessor(file, primitive["indices"]).astype(np.int64).ravel() if "indices" in primitive
               else np.arange(len(vertices)))
    if mode == TRIANGLES:
        faces = corners[:len(corners) // 3 * 3].reshape(-1, 3)
    elif mode == STRIP:
        k = np.arange(max(len(corners) - 2, 0))
        faces = corners[np.stack([k, k + 1 + k % 2, k + 2 - k % 2], axis=1)]
    else:
        faces = np.stack([np.full(len(corners) - 2, corners[0]), corners[1:-1], corners[2:]], axis=1)
    linear_part = matrix[:3, :3]
    if np.linalg.det(linear_part) < 0.0:  # mirrored: outside stays outside
        faces = faces[:, ::-1]
    normals = None
    if "NORMAL" in attributes:
        normals = _accessor(file, attributes["NORMAL"]) @ np.linalg.pinv(linear_part)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        normals = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0.0)
    material = materials[primitive["material"]] if "material" in primitive else Material("", (1.0, 1.0, 1.0))
    uv = _accessor(file, attributes["TEXCOORD_0"]) if "TEXCOORD_0" in attributes else None
    sky = _accessor(file, attributes["_SKY"]).ravel() if "_SKY" in attributes else None
    for name, values in (("NORMAL", normals), ("TEXCOORD_0", uv), ("_SKY", sky)):
        if values is not None and len(values) != len(vertices):
            file.fail(f"{name} holds {len(values)} values for {len(vertices)} vertices")
    return Part(vertices @ linear_part.T + matrix[:3, 3], faces, material, normals, uv, sky)


def _accessor(file: _File, index: int) -> Array:
    """The values of an accessor, (n, width) float64; normalised integers as −1 … 1 or 0 … 1."""
    entry = file.tree["accessors"][index]
    if "sparse" in entry or "bufferView" not in entry:
        file.fail(f"accessor {index} is sparse, which is not read: export without sparse accessors")
    kind: np.dtype[Any] = np.dtype(COMPONENTS[entry["componentType"]])
    width, count = WIDTHS[entry["type"]], int(entry["count"])
    view = file.tree["bufferViews"][entry["bufferView"]]
    data = _view(file, entry["bufferView"])
    start, stride = entry.get("byteOffset", 0), view.get("byteStride", kind.itemsize * width)
    if count < 0 or start < 0 or stride < kind.itemsize * width:
        file.fail(f"accessor {index} has an impossible place or count")
    if count and start + (count - 1) * stride + kind.itemsize * width > len(data):
        file.fail(f"accessor {index} reaches beyond its buffer: is the file cut short?")
    values = np.ndarray((count, width), kind, data, start, (stride, kind.itemsize)).astype(np.float64)
    if entry.get("normalized") and kind.kind in "iu":
        values = np.maximum(values / np.iinfo(kind).max, -1.0)
    return values


def _view(file: _File, index: int) -> bytes:
    view = file.tree["bufferViews"][index]
    start = view.get("byteOffset", 0)
    data = _buffer(file, view["buffer"])[start:start + view["byteLength"]]
    if len(data) < view["byteLength"]:
        file.fail(f"buffer {view['buffer']} is shorter than its views: is the file cut short?")
    return data


def _buffer(file: _File, index: int) -> bytes:
    if index not in file.buffers:
        uri = file.tree["buffers"][index].get("uri")
        file.buffers[index] = file.binary if uri is None else _bytes(file, uri, "buffer")
    return file.buffers[index]


def _bytes(file: _File, uri: str, what: str) -> bytes:
    """What a URI names: data in itself, or a file beside."""
    if uri.startswith("data:"):
        try:
            return base64.b64decode(uri.partition(",")[2], validate=True)
        except binascii.Error as error:
            file.fail(f"a {what} inside it is not readable ({error})")
    beside = file.path.parent / unquote(uri)
    try:
        return beside.read_bytes()
    except OSError as error:
        file.fail(f"its {what} {unquote(uri)!r} cannot be read: {error.strerror or error}")


def _picture(file: _File, texture: Json, load_picture: Callable[[bytes, str], NDArray[np.uint8]]) -> NDArray[np.uint8]:
    if "source" not in file.tree["textures"][texture["index"]]:
        file.fail("a texture is in a format that is not read: export with PNG or JPEG pictures")
    index = file.tree["textures"][texture["index"]]["source"]
    if index not in file.pictures:
        entry = file.tree["images"][index]
        data = _bytes(file, entry["uri"], "picture") if "uri" in entry else _view(file, entry["bufferView"])
        file.pictures[index] = load_picture(data, f"{file.path}: picture {entry.get('name', index)!r}")
    return file.pictures[index]


def _material(file: _File, entry: Json, load_picture: Callable[[bytes, str], NDArray[np.uint8]]) -> Material:
    """Metallic-roughness as diffuse and specular reflectance: a metal has no base, another's surface reflects 4 %."""
    model = entry.get("pbrMetallicRoughness", {})
    base = np.array(model.get("baseColorFactor", [1.0, 1.0, 1.0, 1.0]), dtype=np.float64)
    metallic, roughness = float(model.get("metallicFactor", 1.0)), float(model.get("roughnessFactor", 1.0))
    texture = _picture(file, model["baseColorTexture"], load_picture) if "baseColorTexture" in model else None
    if "metallicRoughnessTexture" in model:  # its mean: what differs over a body is not modelled
        mean = _picture(file, model["metallicRoughnessTexture"], load_picture).reshape(-1, 3).mean(axis=0) / 255.0
        roughness, metallic = roughness * mean[1], metallic * mean[2]
    own = base[:3] if texture is None else base[:3] * linear(texture).reshape(-1, 3).mean(axis=0)
    diffuse = base[:3] * (1.0 - metallic)
    if entry.get("alphaMode") == "BLEND":  # what is behind is taken as dark
        diffuse = diffuse * base[3]
    return Material(str(entry.get("name", "")), _colour(diffuse), _colour(0.04 * (1.0 - metallic) + own * metallic),
                    min(max(roughness, 0.0), 1.0), texture)


def _colour(values: Array) -> Colour:
    red, green, blue = (float(v) for v in np.clip(values, 0.0, 1.0))
    return red, green, blue


def _ground(tree: Json) -> Json | None:
    for mesh in tree.get("meshes", []):
        extras = mesh.get("extras")
        if isinstance(extras, dict) and isinstance(extras.get("ground"), dict):
            return dict(extras["ground"])
    return None


def decoded(data: bytes, name: str) -> NDArray[np.uint8]:
    """A PNG or JPEG picture as (h, w, 3) uint8.

    Raises: FileError for bytes that are no such picture.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"), dtype=np.uint8)
    except UnidentifiedImageError:
        raise FileError(f"{name} is no picture in a format that is read") from None
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise FileError(f"{name} cannot be read: {error}") from None
