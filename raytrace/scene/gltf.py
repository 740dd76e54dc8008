"""A glTF 2.0 file in, its triangles with normals, texture coordinates and materials out.

Read here and not by trimesh, which rounds base colours to 1/255 of linear light, a fifth of a dark tyre's, and leaves out
pictures that are missing without a word.
Source: The Khronos Group, glTF 2.0 specification.
"""

from __future__ import annotations

import base64
import binascii
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple, NoReturn
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import FileError
from raytrace.pictures import Decoded
from raytrace.scene.materials import Colour, Material, linear
from raytrace.scene.parts import Part

Array = NDArray[np.float64]
Json = dict[str, Any]
LoadPicture = Callable[[bytes, str], Decoded]

COMPONENTS = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
TRIANGLES, STRIP, FAN = 4, 5, 6
SPECULAR_GLOSSINESS, TRANSFORM, WEBP = "KHR_materials_pbrSpecularGlossiness", "KHR_texture_transform", "EXT_texture_webp"
# What a file may ask for that is read, is read as any other accessor, or is drawn without it and said.
READ = {"KHR_mesh_quantization", SPECULAR_GLOSSINESS, TRANSFORM, WEBP}
# Of materials and the file, what is not drawn, in the words that say so.
UNDRAWN = {"KHR_materials_unlit": "unlit materials", "KHR_materials_ior": "", "KHR_materials_specular": "specular strength",
           "KHR_materials_clearcoat": "clear coats", "KHR_materials_transmission": "transmission",
           "KHR_materials_volume": "transmission", "KHR_materials_sheen": "sheen", "KHR_materials_iridescence": "iridescence",
           "KHR_materials_anisotropy": "anisotropy", "KHR_materials_dispersion": "dispersion",
           "KHR_materials_diffuse_transmission": "transmission", "KHR_materials_emissive_strength": "emission",
           "KHR_lights_punctual": "lights"}
UNDRAWN_TEXTURES = {"normalTexture": "normal maps", "occlusionTexture": "occlusion maps", "emissiveTexture": "emission"}
# For a bare mesh no extension of looks matters.
LOOKS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "MSFT_texture_")
# The lengths that trimesh, which writes numbers as they are, names in the extras of its meshes.
TRIMESH = "https://github.com/mikedh/trimesh"
METRES_PER_UNIT = {"micron": 1e-6, "um": 1e-6, "mm": 1e-3, "millimeter": 1e-3, "millimeters": 1e-3, "cm": 1e-2,
                   "centimeter": 1e-2, "centimeters": 1e-2, "m": 1.0, "meter": 1.0, "meters": 1.0, "in": 0.0254, "inch": 0.0254,
                   "inches": 0.0254, "ft": 0.3048, "foot": 0.3048, "feet": 0.3048}
MAX_DEPTH = 100  # of the tree of nodes
MAX_NODES = 1_000_000  # a tree whose nodes share their children may be walked for ever


class GltfScene(NamedTuple):
    """What a glTF file shows.

    Attributes
    ----------
    parts : its triangles, one part a primitive, y up, in the file's unit.
    metres : that unit, m.
    ground : the "ground" of its extras; None without one.
    left_out : what is not drawn, in some words each.
    """

    parts: list[Part]
    metres: float
    ground: Json | None
    left_out: tuple[str, ...]


class _Look(NamedTuple):
    """A material, and where its pictures lie: on which texture coordinates, turned and moved by a (2, 3) matrix.

    metal : what its specular reflectance owes to a metal's colour, which colours of vertices tint too.
    """

    material: Material
    channel: int = 0
    transform: Array | None = None
    metal: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass
class _File:
    """The parts of an opened file. Missing and impossible entries become FileError by `read_gltf`."""

    path: Path
    tree: Json
    binary: bytes
    buffers: dict[int, bytes] = field(default_factory=dict)
    pictures: dict[int, Decoded] = field(default_factory=dict)
    left_out: set[str] = field(default_factory=set)
    nodes: int = 0

    def fail(self, message: str) -> NoReturn:
        raise FileError(f"{self.path}: {message}")


def read_gltf(path: Path, load_picture: LoadPicture | None = None) -> GltfScene:
    """Read the triangles of a glTF file's scene.

    In metres by the standard, whatever extras say; only trimesh writes its numbers as they are and their unit in extras.

    Parameters
    ----------
    path : of a .gltf or .glb file.
    load_picture : makes the picture of its bytes and its name; without it no materials are read, and all parts are white.

    Returns
    -------
    GltfScene

    Raises
    ------
    FileError
        For a file that is no glTF 2.0, is cut short, or needs what is not read here; for pictures and buffers that are missing.

    References
    ----------
    The Khronos Group, glTF 2.0 specification.
    """
    file = _opened(path)
    try:
        needs = {name for name in file.tree.get("extensionsRequired", []) if name not in READ and name not in UNDRAWN}
        needs = {name for name in needs if load_picture is not None or not str(name).startswith(LOOKS)}
        if needs:
            file.fail(f"needs the glTF extension {', '.join(sorted(needs))}, which is not read: export without compression "
                      "and without it")
        looks = [] if load_picture is None else [_look(file, entry, load_picture) for entry in file.tree.get("materials", [])]
        parts = [part for root in _roots(file.tree) for part in _node(file, root, np.eye(4), looks, 0)]
        left_out = file.left_out | {UNDRAWN.get(name, f"extension {name}") for name in file.tree.get("extensionsUsed", [])
                                    if name not in READ and not str(name).startswith("KHR_materials_")}
        return GltfScene(parts, _metres(file), _ground(file.tree), tuple(sorted(left_out - {""})))
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError, RecursionError, MemoryError,
            np.linalg.LinAlgError) as error:
        raise FileError(f"{path}: not a readable glTF file ({type(error).__name__}: {error})") from None


def _metres(file: _File) -> float:
    """Metres per unit of the file's numbers."""
    if file.tree["asset"].get("generator") != TRIMESH:
        return 1.0
    named = {str(entry["extras"]["units"]).lower() for key in ("meshes", "scenes") for entry in file.tree.get(key, [])
             if isinstance(entry.get("extras"), dict) and "units" in entry["extras"]}
    named -= {"none"}  # as it writes where it knows none
    if len(named) > 1:
        file.fail(f"its meshes are in different units ({', '.join(sorted(named))}): export them in one")
    unit = next(iter(named), "m")
    if unit not in METRES_PER_UNIT:
        file.fail(f"its unit {unit!r} is none of {', '.join(METRES_PER_UNIT)}")
    return METRES_PER_UNIT[unit]


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


def _node(file: _File, index: int, above: Array, looks: list[_Look], depth: int) -> Iterator[Part]:
    if depth > MAX_DEPTH:
        file.fail("its nodes hang on themselves, or more than a hundred deep")
    file.nodes += 1
    if file.nodes > MAX_NODES:
        file.fail(f"its scene shows more than {MAX_NODES} nodes")
    node = file.tree["nodes"][index]
    matrix = above @ _transform(node)
    if "mesh" in node:
        for primitive in file.tree["meshes"][node["mesh"]]["primitives"]:
            part = _primitive(file, primitive, matrix, looks)
            if part is not None:
                yield part
    for child in node.get("children", []):
        yield from _node(file, child, matrix, looks, depth + 1)


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


def _primitive(file: _File, primitive: Json, matrix: Array, looks: list[_Look]) -> Part | None:
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
    look = looks[primitive["material"]] if "material" in primitive and looks else _Look(Material("", (1.0, 1.0, 1.0)))
    channel = f"TEXCOORD_{look.channel}"
    uv = _accessor(file, attributes[channel]) if channel in attributes and looks else None
    sky = _accessor(file, attributes["_SKY"]).ravel() if "_SKY" in attributes else None
    colours = _accessor(file, attributes["COLOR_0"]) if "COLOR_0" in attributes else None
    for name, values in (("NORMAL", normals), (channel, uv), ("_SKY", sky), ("COLOR_0", colours)):
        if values is not None and len(values) != len(vertices):
            file.fail(f"{name} holds {len(values)} values for {len(vertices)} vertices")
    if uv is None and (look.material.texture is not None or look.material.cover is not None):
        file.left_out.add(f"pictures of parts without {channel}")
    if uv is not None and look.transform is not None:
        uv = uv[:, :2] @ look.transform[:, :2].T + look.transform[:, 2]
    material = look.material
    if colours is not None:
        colours = np.clip(np.nan_to_num(np.concatenate([colours, np.ones((len(colours), 1))], axis=1)[:, :4]), 0.0, 1.0)
        if any(look.metal):  # a metal's colour is that of what it mirrors, of which a material has one
            tint = colours[np.unique(faces), :3].mean(axis=0) if faces.size else np.ones(3)
            specular = np.array(material.specular) - np.array(look.metal) * (1.0 - tint)
            material = replace(material, specular=_colour(specular))
    return Part(vertices @ linear_part.T + matrix[:3, 3], faces, material, normals, uv, sky, colours)


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
    with np.errstate(invalid="ignore"):  # NaN of some patterns of bits; what is no place is refused later
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


def _picture(file: _File, texture: Json, load_picture: LoadPicture) -> Decoded:
    entry = file.tree["textures"][texture["index"]]
    source = entry.get("source", entry.get("extensions", {}).get(WEBP, {}).get("source"))
    if source is None:
        file.fail("a texture is in a format that is not read: export with PNG or JPEG pictures")
    if source not in file.pictures:
        image = file.tree["images"][source]
        data = _bytes(file, image["uri"], "picture") if "uri" in image else _view(file, image["bufferView"])
        file.pictures[source] = load_picture(data, f"{file.path}: picture {image.get('name', source)!r}")
    return file.pictures[source]


def _placed(texture: Json) -> tuple[int, Array | None]:
    """The set of texture coordinates that a texture lies on, and what is done to them, (2, 3); None for nothing.

    KHR_texture_transform: offset, counter-clockwise turn and scale as one matrix.
    """
    channel = int(texture.get("texCoord", 0))
    change = texture.get("extensions", {}).get(TRANSFORM)
    if change is None:
        return channel, None
    turn = float(change.get("rotation", 0.0))
    su, sv = (float(v) for v in change.get("scale", [1.0, 1.0]))
    ou, ov = (float(v) for v in change.get("offset", [0.0, 0.0]))
    cosine, sine = np.cos(turn), np.sin(turn)
    return int(change.get("texCoord", channel)), np.array([[cosine * su, sine * sv, ou], [-sine * su, cosine * sv, ov]])


def _look(file: _File, entry: Json, load_picture: LoadPicture) -> _Look:
    """A material by its metalness and roughness, or its specular reflectance and glossiness, and how much it covers."""
    extensions = entry.get("extensions", {})
    glossy = extensions.get(SPECULAR_GLOSSINESS)
    model = glossy if glossy is not None else entry.get("pbrMetallicRoughness", {})
    base = _factor(model, "baseColorFactor" if glossy is None else "diffuseFactor", 4)
    lain = model.get("baseColorTexture" if glossy is None else "diffuseTexture")
    texture = None if lain is None else _picture(file, lain, load_picture)
    channel, transform = (0, None) if lain is None else _placed(lain)
    mean = np.ones(3) if texture is None else linear(texture.colours).reshape(-1, 3).mean(axis=0)
    metal = np.zeros(3)
    if glossy is None:
        # A metal has no base, another's surface reflects 4 %.
        metallic, roughness = float(model.get("metallicFactor", 1.0)), float(model.get("roughnessFactor", 1.0))
        if "metallicRoughnessTexture" in model:  # its mean: what differs over a body is not modelled
            share = _picture(file, model["metallicRoughnessTexture"], load_picture).colours.reshape(-1, 3).mean(axis=0) / 255.0
            roughness, metallic = roughness * share[1], metallic * share[2]
        metal = base[:3] * mean * metallic
        diffuse, specular = base[:3] * (1.0 - metallic), 0.04 * (1.0 - metallic) + metal
    else:
        specular, roughness = _factor(model, "specularFactor", 3), 1.0 - float(model.get("glossinessFactor", 1.0))
        if "specularGlossinessTexture" in model:
            given = _picture(file, model["specularGlossinessTexture"], load_picture)
            specular = specular * linear(given.colours).reshape(-1, 3).mean(axis=0)
            if given.alpha is not None:
                roughness = 1.0 - (1.0 - roughness) * float(given.alpha.mean()) / 255.0
        diffuse = base[:3]
    file.left_out |= {UNDRAWN.get(name, f"extension {name}") for name in extensions if name != SPECULAR_GLOSSINESS}
    file.left_out |= {words for name, words in UNDRAWN_TEXTURES.items() if name in entry}
    if any(entry.get("emissiveFactor", ())):
        file.left_out.add("emission")
    mode = entry.get("alphaMode", "OPAQUE")
    material = Material(str(entry.get("name", "")), _colour(diffuse), _colour(specular), min(max(roughness, 0.0), 1.0),
                        None if texture is None else texture.colours)
    if mode != "OPAQUE":
        material = replace(material, opacity=float(np.clip(base[3], 0.0, 1.0)),
                           cover=None if texture is None else texture.alpha,
                           cutoff=max(float(entry.get("alphaCutoff", 0.5)), 0.0) if mode == "MASK" else None)
    return _Look(material, channel, transform, _colour(metal))


def _factor(model: Json, name: str, width: int) -> Array:
    values = np.array(model.get(name, [1.0] * width), dtype=np.float64)
    if values.shape != (width,) or not np.isfinite(values).all():
        raise ValueError(f"{name} is no row of {width} numbers")
    return values


def _colour(values: Array) -> Colour:
    red, green, blue = (float(v) for v in np.clip(values, 0.0, 1.0))
    return red, green, blue


def _ground(tree: Json) -> Json | None:
    for mesh in tree.get("meshes", []):
        extras = mesh.get("extras")
        if isinstance(extras, dict) and isinstance(extras.get("ground"), dict):
            return dict(extras["ground"])
    return None
