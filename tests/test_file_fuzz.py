"""Files damaged at random: each is read, or refused with a clear error; no other exception, no NaN, no hang.

Made from good files of the project's own: texts lose, double and change words and lines, binary files bytes and lengths, JSON
its values. Seeded, so that a fault is found again.
"""

from __future__ import annotations

import io
import json
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageCms

from mirror_cad.errors import FileError, MirrorError
from mirror_cad.mesh import SurfaceMesh
from mirror_cad.stl_file import read_stl
from raytrace import load_reflector
from raytrace.errors import SceneError
from raytrace.pictures import decoded
from raytrace.scene.bodies import read_body
from raytrace.scene.reference import load_picture
from raytrace.surfaces.mesh import MeshSurface
from tests.meshes import cap
from tests.test_bodies import Glb, png
from tests.test_mesh_reflectors import ascii_ply, binary_ply, obj, off, write_3mf

LONGEST_S = 60.0  # for one small file, on a machine that does other things
SPOILT = [b"nan", b"-1", b"0", b"99999999999", b"1e400", b"x", b"", b"\xff\xfe", b"-", b"/", b"1/", b"\0", b"inf",
          b"2147483648", b"\\", b'"', b"4294967295", b"\xc3("]
PICTURE = np.random.default_rng(1).integers(0, 256, (12, 10, 4), dtype=np.uint8)


def sheet() -> SurfaceMesh:
    vertices, faces, _ = cap(4)
    return SurfaceMesh(vertices, faces)


def pictured_obj() -> bytes:
    mesh = sheet()
    uv = "".join(f"vt {x / 250.0} {y / 400.0}\n" for x, y in mesh.vertices[:, :2].tolist())
    rows = "".join(f"f {a}/{a} {b}/{b} {c}/{c}\n" for a, b, c in (mesh.faces + 1).tolist())
    places = obj(mesh).split(b"f ", 1)[0]
    return b"mtllib a.mtl\n" + places + uv.encode() + b"usemtl wall\n" + rows.encode() + b"f -1 -2 -3 -4 -6\n"


def coloured_ply() -> bytes:
    mesh = sheet()
    head = (f"ply\nformat binary_little_endian 1.0\nelement vertex {len(mesh.vertices)}\nproperty float x\nproperty float y\n"
            f"property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nelement face {len(mesh.faces)}\n"
            "property list uchar int vertex_indices\nend_header\n").encode()
    row = np.zeros(len(mesh.vertices), dtype=[("p", "<f4", 3), ("c", "u1", 3)])
    row["p"], row["c"] = mesh.vertices, 200
    face = np.zeros(len(mesh.faces), dtype=[("n", "u1"), ("v", "<i4", 3)])
    face["n"], face["v"] = 3, mesh.faces
    return head + row.tobytes() + face.tobytes()


def glb() -> bytes:
    mesh, file = sheet(), Glb()
    texture = {"index": file.texture(png(PICTURE)), "extensions": {"KHR_texture_transform": {"rotation": 0.3}}}
    material = {"alphaMode": "MASK", "pbrMetallicRoughness": {"baseColorTexture": texture}}
    file.mesh(mesh.vertices / 1000.0, mesh.faces, material, {"units": "mm"}, TEXCOORD_0=mesh.vertices[:, :2] / 200.0,
              COLOR_0=np.full((len(mesh.vertices), 3), 0.5))
    return file.bytes()


def three_mf(folder: Path) -> bytes:
    write_3mf(folder / "good.3mf", sheet(), "millimeter")
    return (folder / "good.3mf").read_bytes()


def stl() -> bytes:
    corners = sheet().vertices[sheet().faces]
    rows = np.zeros(len(corners), dtype=[("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    rows["v"] = corners
    return bytes(80) + len(rows).to_bytes(4, "little") + rows.tobytes()


def text_stl() -> bytes:
    lines = ["solid a"]
    for corner in sheet().vertices[sheet().faces].tolist():
        lines += ["facet normal 0 0 1", "outer loop", *(f"vertex {x} {y} {z}" for x, y, z in corner), "endloop", "endfacet"]
    return "\n".join([*lines, "endsolid a", ""]).encode()


def picture(kind: str) -> bytes:
    stream, exif = io.BytesIO(), Image.Exif()
    exif[0x112] = 6
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    Image.fromarray(PICTURE if kind == "PNG" else PICTURE[..., :3]).save(stream, kind, exif=exif, icc_profile=profile)
    return stream.getvalue()


def good(folder: Path) -> dict[str, bytes]:
    """One file of each kind by its name."""
    mesh = sheet()
    return {"a.obj": pictured_obj(), "a.mtl": b"newmtl wall\nKd 0.5 0.4 0.3\nNs 20\nd 0.9\nmap_Kd -s 1 2 -o 0.1 0.2 a.png\n",
            "text.ply": ascii_ply(mesh), "binary.ply": binary_ply(mesh), "coloured.ply": coloured_ply(), "a.off": off(mesh),
            "a.glb": glb(), "a.3mf": three_mf(folder), "a.stl": stl(), "text.stl": text_stl(), "a.png": picture("PNG"),
            "a.jpg": picture("JPEG"), "a.webp": picture("WEBP"), "a.pgm": b"P5\n6 5\n1023\n" + bytes(60)}


def of_text(rng: np.random.Generator, data: bytes) -> bytes:
    lines = data.split(b"\n")
    for _ in range(int(rng.integers(1, 4))):
        k = int(rng.integers(len(lines)))
        words = lines[k].split(b" ")
        w = int(rng.integers(len(words)))
        match int(rng.integers(6)):
            case 0:
                words[w] = SPOILT[int(rng.integers(len(SPOILT)))]
            case 1:
                del words[w]
            case 2:
                words.insert(w, SPOILT[int(rng.integers(len(SPOILT)))])
            case 3:
                words = []
            case 4:
                words = [lines[int(rng.integers(len(lines)))]]
            case _:
                return b"\n".join(lines)[:int(rng.integers(len(data)))]
        lines[k] = b" ".join(words)
    return b"\n".join(lines)


def of_bytes(rng: np.random.Generator, data: bytes) -> bytes:
    made = bytearray(data)
    for _ in range(int(rng.integers(1, 5))):
        at = int(rng.integers(len(made)))
        match int(rng.integers(5)):
            case 0:
                made[at] = int(rng.integers(256))
            case 1:
                made[at:at + 4] = int(rng.choice([0, 1, 0xFFFFFFFF, 0x7FFFFFFF, 0x7FC00000, 1000])).to_bytes(4, "little")
            case 2:
                del made[at:at + int(rng.integers(1, 9))]
            case 3:
                made[at:at] = bytes(rng.integers(0, 256, int(rng.integers(1, 9)), dtype=np.uint8))
            case _:
                return bytes(made[:at])
        if not made:
            break
    return bytes(made)


def values_in(node: Any) -> list[tuple[Any, Any]]:
    """Every value below a node of JSON, as what holds it and its key."""
    keys = list(node) if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else []
    return [(node, key) for key in keys] + [found for key in keys for found in values_in(node[key])]


def of_json(rng: np.random.Generator, data: bytes) -> bytes:
    """A GLB with one or two values of its tree changed, its lengths right."""
    length = int.from_bytes(data[12:16], "little")
    tree, rest = json.loads(data[20:20 + length]), data[20 + length:]
    spoilt = [None, -1, 0, 1e9, "x", [], {}, [None], float(rng.normal()), True, 3.7, 2**40]
    for _ in range(int(rng.integers(1, 3))):
        places = values_in(tree)
        node, key = places[int(rng.integers(len(places)))]
        if rng.random() < 0.3:
            del node[key]
        else:
            node[key] = spoilt[int(rng.integers(len(spoilt)))]
        if not tree:
            break
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    body = len(text).to_bytes(4, "little") + b"JSON" + text + rest
    return b"glTF" + (2).to_bytes(4, "little") + (12 + len(body)).to_bytes(4, "little") + body


def finite(*arrays: np.ndarray) -> None:
    for values in arrays:
        assert np.isfinite(values).all()


def as_reflector(path: Path) -> None:
    if path.suffix == ".stl":
        mesh = read_stl(path)
    else:
        surface = load_reflector(path, normals="interpolated").surface
        assert isinstance(surface, MeshSurface)
        mesh = surface.mesh
    finite(mesh.vertices, mesh.facet_normals())
    assert mesh.faces.min() >= 0
    assert mesh.faces.max() < len(mesh.vertices)


def as_body(path: Path) -> None:
    body = read_body(path.with_name("a.obj") if path.suffix == ".mtl" else path)
    finite(body.vertices, body.normals, body.sky, *([] if body.colours is None else [body.colours]))


def as_picture(path: Path) -> None:
    assert load_picture(path).dtype == np.uint8
    decoded(path.read_bytes(), path.name, as_stored=True)


def readers(name: str) -> list[Callable[[Path], None]]:
    match Path(name).suffix:
        case ".png" | ".jpg" | ".webp" | ".pgm":
            return [as_picture]
        case ".mtl":
            return [as_body]
        case _:
            return [as_reflector, as_body]


def fuzz(folder: Path, seed: int, count: int) -> dict[str, int]:
    """Read so many damaged files; returns how many were read and how many refused."""
    rng, files = np.random.default_rng(seed), good(folder)
    for name, data in files.items():
        (folder / name).write_bytes(data)
    done = {"read": 0, "refused": 0}
    names = list(files)
    for number in range(count):
        name = names[number % len(names)]
        text = name in ("a.obj", "a.mtl", "text.ply", "a.off", "text.stl")
        change = of_json if name == "a.glb" and number // len(names) % 2 else of_text if text else of_bytes
        damaged = change(rng, files[name])
        (folder / name).write_bytes(damaged)
        for read in readers(name):
            began = time.perf_counter()
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("error", RuntimeWarning)
                    read(folder / name)
                done["read"] += 1
            except (FileError, SceneError, MirrorError) as error:
                assert name.partition(".")[0] in str(error), (number, name, str(error))
                done["refused"] += 1
            except Exception as error:
                kept = folder.parent / f"fuzz-{seed}-{number}-{name}"
                kept.write_bytes(damaged)
                raise AssertionError(f"{kept}: {read.__name__}: {type(error).__name__}: {error}") from error
            assert time.perf_counter() - began < LONGEST_S, (number, name)
        (folder / name).write_bytes(files[name])
    return done


def test_the_good_files_are_read(tmp_path: Path) -> None:
    """Or the fuzz would try nothing."""
    for name, data in good(tmp_path).items():
        (tmp_path / name).write_bytes(data)
    for name in good(tmp_path):
        for read in readers(name):
            read(tmp_path / name)


def test_a_few_damaged_files_are_read_or_refused(tmp_path: Path) -> None:
    done = fuzz(tmp_path, 14, 140)
    assert min(done.values()) > 30


@pytest.mark.long
@pytest.mark.parametrize("seed", range(8))
def test_many_damaged_files_are_read_or_refused(tmp_path: Path, seed: int) -> None:
    """2240 in all."""
    done = fuzz(tmp_path, seed, 280)
    assert min(done.values()) > 60
