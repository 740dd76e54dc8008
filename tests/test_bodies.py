"""Bodies from files: where they stand, what they are made of, how much sky their places see; and every bad file refused."""

from __future__ import annotations

import base64
import io
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from mirror_cad.errors import FileError
from raytrace.embree import TriangleScene
from raytrace.errors import SceneError
from raytrace.scene import bodies
from raytrace.scene.bodies import Body, body_of, read_body
from raytrace.scene.materials import Material
from raytrace.scene.visibility import contact, openness
from tests.meshes import box, grid, icosphere, unit

GRAY = Material("gray", (0.5, 0.5, 0.5))
# Of a share from 64 stratified directions: three standard deviations, measured.
SHARE_NOISE = 0.05
FACE = np.array([[0, 1, 2]])


def png(picture: np.ndarray) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(picture).save(stream, "PNG")
    return stream.getvalue()


class Glb:
    """A glTF file in the making: its JSON tree and its binary chunk."""

    def __init__(self) -> None:
        self.tree: dict[str, Any] = {
            "asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "scene": 0, "nodes": [{"mesh": 0}], "meshes": [],
            "accessors": [], "bufferViews": [], "materials": [], "images": [], "textures": []}
        self.binary = b""

    def view(self, data: bytes) -> int:
        self.tree["bufferViews"].append({"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data)})
        self.binary += data + b"\0" * (-len(data) % 4)
        return len(self.tree["bufferViews"]) - 1

    def accessor(self, values: np.ndarray, kind: str) -> int:
        component = {"f": 5126, "u": {1: 5121, 2: 5123, 4: 5125}.get(values.dtype.itemsize)}[values.dtype.kind]
        self.tree["accessors"].append({"bufferView": self.view(values.tobytes()), "componentType": component,
                                       "count": len(values), "type": kind})
        return len(self.tree["accessors"]) - 1

    def mesh(self, vertices: np.ndarray, faces: np.ndarray, material: dict[str, Any] | None = None, extras: Any = None,
             **attributes: np.ndarray) -> Glb:
        widths = {1: "SCALAR", 2: "VEC2", 3: "VEC3"}
        primitive: dict[str, Any] = {"attributes": {"POSITION": self.accessor(vertices.astype(np.float32), "VEC3")}}
        for name, values in attributes.items():
            width = 1 if values.ndim == 1 else values.shape[1]
            primitive["attributes"][name] = self.accessor(values.astype(np.float32), widths[width])
        primitive["indices"] = self.accessor(faces.astype(np.uint32).ravel(), "SCALAR")
        if material is not None:
            self.tree["materials"].append(material)
            primitive["material"] = len(self.tree["materials"]) - 1
        self.tree["meshes"].append({"primitives": [primitive]} | ({"extras": extras} if extras is not None else {}))
        return self

    def texture(self, data: bytes) -> int:
        self.tree["images"].append({"bufferView": self.view(data), "mimeType": "image/png", "name": "plate"})
        self.tree["textures"].append({"source": len(self.tree["images"]) - 1})
        return len(self.tree["textures"]) - 1

    def bytes(self) -> bytes:
        tree = self.tree | {"buffers": [{"byteLength": len(self.binary)}]}
        text = json.dumps({key: value for key, value in tree.items() if value != []}).encode()
        text += b" " * (-len(text) % 4)
        both = ((b"JSON", text), (b"BIN\0", self.binary))
        chunks = b"".join(len(data).to_bytes(4, "little") + kind + data for kind, data in both)
        return b"glTF" + (2).to_bytes(4, "little") + (12 + len(chunks)).to_bytes(4, "little") + chunks

    def write(self, path: Path) -> Path:
        path.write_bytes(self.bytes())
        return path


def car() -> tuple[np.ndarray, np.ndarray]:
    """A box of a car's size as glTF has it: y up, its front end at z = 0 looking along +z; metres."""
    vertices, faces = box(2)
    return vertices / [1.0, 0.65, 0.45] * [0.9, 0.7, 2.2] + [0.0, 0.9, -2.2], faces


def simple(path: Path) -> Path:
    return Glb().mesh(*car()).write(path)


def extent(body: Body) -> np.ndarray:
    used = body.vertices[np.unique(body.faces)]
    return np.stack([used.min(axis=0), used.max(axis=0)])


def test_a_gltf_vehicle_has_its_front_at_the_origin_and_its_right_at_plus_y(tmp_path: Path) -> None:
    """Along glTF's axes: x to the left, y up, z ahead."""
    vertices, faces = car()
    marks = vertices + np.where(vertices[:, :1] > 0.5, [[0.0, 0.3, 0.0]], 0.0)  # its left side is higher
    body = read_body(Glb().mesh(marks, faces).write(tmp_path / "car.glb"))
    assert extent(body) == pytest.approx(np.array([[0.0, -900.0, 200.0], [4400.0, 900.0, 1900.0]]), abs=1e-3)
    assert body.vertices[body.vertices[:, 2] > 1700.0, 1].max() < 0.0  # left is −Y
    volume = np.einsum("ij,ij->i", body.vertices[body.faces[:, 0]],
                       np.cross(body.vertices[body.faces[:, 1]], body.vertices[body.faces[:, 2]])).sum() / 6.0
    assert volume > 0.0  # outside stays outside
    corner = body.vertices[body.faces]
    facet = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    assert (np.einsum("ij,ikj->ik", facet, body.normals[body.faces]) > 0.0).all()


@pytest.mark.parametrize(("heading", "expected"), [
    (0.0, [[5000.0, -900.0], [9400.0, 900.0]]), (90.0, [[4100.0, -4400.0], [5900.0, 0.0]]),
    (180.0, [[600.0, -900.0], [5000.0, 900.0]]), (-90.0, [[4100.0, 0.0], [5900.0, 4400.0]])])
def test_a_body_turns_to_the_right_with_its_heading(tmp_path: Path, heading: float, expected: list[list[float]]) -> None:
    body = read_body(simple(tmp_path / "car.glb"))
    placed = body.placed((5000.0, 0.0, 0.0), heading)
    assert extent(placed)[:, :2] == pytest.approx(np.array(expected), abs=1e-3)
    assert extent(placed)[:, 2] == pytest.approx(extent(body)[:, 2])
    assert np.linalg.norm(placed.normals, axis=1) == pytest.approx(np.ones(len(placed.normals)))
    shadow, moved = body.contact, placed.contact
    assert shadow is not None
    assert moved is not None
    # The grid goes with the body: its middle stays under the body's.
    half = 0.5 * (np.array(shadow.sky.shape) - 1.0)
    assert moved.origin + half[0] * moved.along + half[1] * moved.across == pytest.approx(
        extent(placed)[:, :2].mean(axis=0), abs=1.0)
    assert body.placed((0.0, 0.0, 100.0)).contact is None


def test_nodes_are_placed_turned_and_mirrored_as_the_file_says(tmp_path: Path) -> None:
    file = Glb().mesh(*car())
    file.tree["nodes"] = [{"children": [1, 2], "translation": [0, 0, -10]},
                          {"mesh": 0, "rotation": [0, np.sqrt(0.5), 0, np.sqrt(0.5)]},
                          {"mesh": 0, "scale": [-1, 1, 1], "translation": [5, 0, 0]}]
    body = read_body(file.write(tmp_path / "two.glb"))
    # The first, a quarter turn about y, reaches from z = −0.9 to 0.9 and x = −4.4 to 0 before the shift by −10 along z.
    assert extent(body) == pytest.approx(np.array([[9100.0, -5900.0, 200.0], [14400.0, 4400.0, 1600.0]]), abs=1e-2)
    corner = body.vertices[body.faces]
    facet = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    assert (np.einsum("ij,ikj->ik", facet, body.normals[body.faces]) > 0.0).all()


def test_materials_keep_their_linear_colours_exactly(tmp_path: Path) -> None:
    tyre = {"name": "tyre", "pbrMetallicRoughness": {"baseColorFactor": [0.0131, 0.0127, 0.012, 1.0], "metallicFactor": 0.0,
                                                     "roughnessFactor": 0.85}}
    chrome = {"name": "chrome", "pbrMetallicRoughness": {"baseColorFactor": [0.9, 0.8, 0.7, 1.0], "roughnessFactor": 0.1}}
    file = Glb().mesh(*car(), material=tyre).mesh(*car(), material=chrome)
    file.tree["nodes"] = [{"mesh": 0, "children": [1]}, {"mesh": 1, "translation": [3, 0, 0]}]
    made = {m.name: m for m in read_body(file.write(tmp_path / "car.glb")).materials}
    assert made["tyre"].diffuse == (0.0131, 0.0127, 0.012)
    assert made["tyre"].specular == (0.04, 0.04, 0.04)
    assert made["tyre"].roughness == 0.85
    assert made["chrome"].diffuse == (0.0, 0.0, 0.0)  # a metal, the standard's default
    assert made["chrome"].specular == (0.9, 0.8, 0.7)


def test_a_scene_chooses_the_colour_of_the_paint_and_of_nothing_else(tmp_path: Path) -> None:
    file = Glb().mesh(*car(), material={"name": "paint", "pbrMetallicRoughness": {"metallicFactor": 0.0}})
    file.mesh(*car(), material={"name": "glass", "pbrMetallicRoughness": {"metallicFactor": 0.0}})
    file.tree["nodes"] = [{"mesh": 0, "children": [1]}, {"mesh": 1}]
    body = read_body(file.write(tmp_path / "car.glb")).painted((0.1, 0.2, 0.3))
    assert [m.diffuse for m in body.materials] == [(0.1, 0.2, 0.3), (1.0, 1.0, 1.0)]
    with pytest.raises(SceneError, match="no material is named 'paint': this body's are ''"):
        read_body(simple(tmp_path / "bare.glb")).painted((0.1, 0.2, 0.3))


def test_baked_shares_ground_and_textures_are_taken_from_the_file(tmp_path: Path) -> None:
    vertices, faces = car()
    sky = np.linspace(0.0, 1.0, len(vertices))
    uv = np.linspace(0.0, 2.0, 2 * len(vertices)).reshape(-1, 2)
    picture = np.random.default_rng(1).integers(0, 255, (5, 7, 3), dtype=np.uint8)
    file = Glb()
    material = {"pbrMetallicRoughness": {"metallicFactor": 0.0, "baseColorTexture": {"index": file.texture(png(picture))}}}
    share = np.round(np.linspace(0.1, 1.0, 6), 2)
    file.mesh(vertices, faces, material, {"ground": {"x0": -0.2, "dx": 2.4, "nx": 3, "y0": -1.1, "dy": 2.2, "ny": 2,
                                                     "sky": share.tolist()}},
              NORMAL=unit(vertices), TEXCOORD_0=uv, _SKY=sky)
    body = read_body(file.write(tmp_path / "car.glb"))
    assert body.sky == pytest.approx(sky, abs=1e-7)
    assert body.uv == pytest.approx(uv, abs=1e-6)
    assert body.normals == pytest.approx(unit(vertices) @ bodies.WORLD_FROM_Y_UP.T, abs=1e-6)
    assert np.array_equal(body.materials[0].texture, picture)
    shadow = body.contact
    assert shadow is not None
    assert shadow.sky == pytest.approx(share.reshape(3, 2))
    assert shadow.origin == pytest.approx([-200.0, -1100.0])
    assert (shadow.along[0], shadow.across[1]) == (2400.0, 2200.0)


@pytest.mark.parametrize("kind", [".stl", ".obj", ".ply", ".off"])
def test_files_without_a_unit_are_in_mm_or_in_the_stated_one(tmp_path: Path, kind: str) -> None:
    import trimesh

    vertices, faces = box(1)
    path = tmp_path / f"box{kind}"
    trimesh.Trimesh(vertices * [1.0, 2.0, 3.0] + [7.0, 0.0, 0.0], faces, process=False).export(path)
    size = np.array([[6.0, -1.3, -1.35], [8.0, 1.3, 1.35]])
    assert extent(read_body(path, unit="m")) == pytest.approx(1000.0 * size, rel=1e-6)
    assert extent(read_body(path, unit="inch")) == pytest.approx(25.4 * size, rel=1e-6)
    with pytest.raises(FileError, match=r"it is 2\.7 mm across, .* is it in metres\? unit = \"m\""):
        read_body(path)
    turned = extent(read_body(path, unit="m", up="y"))
    assert turned == pytest.approx(1000.0 * np.array([[-1.35, -8.0, -1.3], [1.35, -6.0, 1.3]]), rel=1e-6)


def test_an_obj_s_materials_and_pictures_are_read(tmp_path: Path) -> None:
    picture = np.full((4, 4, 3), 200, dtype=np.uint8)
    (tmp_path / "wall.png").write_bytes(png(picture))
    (tmp_path / "wall.mtl").write_text(
        "newmtl wall\nKd 0.123 0.5 0.25\nNs 1000\nmap_Kd wall.png\nnewmtl post\nKd 0.2 0.2 0.2\n")
    (tmp_path / "wall.obj").write_text(
        "mtllib wall.mtl\nv 0 0 0\nv 0 1000 0\nv 0 1000 900\nv 0 0 900\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl wall\n"
        "f 1/1 2/2 3/3\nf 1/1 3/3 4/4\nv 0 2000 0\nv 0 2100 0\nv 0 2000 300\nusemtl post\nf 5/1 6/2 7/3\n")
    body = read_body(tmp_path / "wall.obj")
    wall, post = sorted(body.materials, key=lambda m: m.texture is None)
    assert wall.diffuse == (0.123, 0.5, 0.25)
    assert wall.roughness == pytest.approx((2.0 / 1002.0) ** 0.25)
    assert np.array_equal(wall.texture, picture)
    assert post.diffuse == (0.2, 0.2, 0.2)
    top = body.vertices[:, 2] == 900.0
    assert (body.uv[top, 1] == 0.0).all()  # a picture's first row is its top


def test_normals_of_a_file_without_them_are_smooth_on_a_ball_and_sharp_on_a_box() -> None:
    vertices, faces = icosphere(4)
    ball = body_of(500.0 * vertices, faces, GRAY)
    assert len(ball.vertices) == len(vertices)
    assert np.abs(np.einsum("ij,ij->i", ball.normals, unit(ball.vertices)) - 1.0).max() < 1e-5
    vertices, faces = box(3)
    crate = body_of(1000.0 * vertices, faces, GRAY)
    assert (np.abs(crate.normals).max(axis=1) > 1.0 - 1e-9).all()


@pytest.mark.parametrize("open_to", [0.9, 0.5, -0.3])
def test_every_place_in_a_sphere_with_an_opening_sees_the_same_share(open_to: float) -> None:
    """Closed form: a sphere sends from any place the same share to any part of it, its part of the area, (1 − h)/2."""
    vertices, faces = icosphere(5)
    kept = faces[vertices[faces].mean(axis=1)[:, 2] < open_to][:, ::-1]
    corner = vertices[faces]
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    opening = area[vertices[faces].mean(axis=1)[:, 2] >= open_to].sum() / area.sum()
    assert opening == pytest.approx(0.5 * (1.0 - open_to), abs=0.01)
    body = body_of(1000.0 * vertices, kept, GRAY)
    found = body.sky[np.unique(body.faces)]
    assert found.mean() == pytest.approx(opening, abs=0.005)
    assert np.abs(found - opening).max() < 0.09  # at the rim, where a few directions more or less get out


@pytest.mark.parametrize("depth", [0.5, 1.0, 2.0])
def test_the_floor_of_a_well_sees_sin_squared_of_its_opening(depth: float) -> None:
    """Closed form on the axis: V = sin² α = r²/(r² + h²)."""
    turn = np.arange(96) * 2.0 * np.pi / 96
    ring = np.stack([np.cos(turn), np.sin(turn), np.zeros(96)], axis=1)
    vertices = 1000.0 * np.concatenate([[[0.0, 0, 0]], ring, ring + [0.0, 0, depth]])
    k, following = np.arange(96) + 1, (np.arange(96) + 1) % 96 + 1
    faces = np.concatenate([np.stack([np.zeros(96, dtype=int), k, following], axis=1),
                            np.stack([k, k + 96, following], axis=1), np.stack([following, k + 96, following + 96], axis=1)])
    scene = TriangleScene(vertices, faces)
    places = np.array([[0.0, 0.0, 0.01]]) + np.random.default_rng(1).uniform(-3.0, 3.0, (400, 3)) * [1.0, 1.0, 0.0]
    found = openness(scene, places, np.tile([0.0, 0.0, 1.0], (400, 1)))
    assert found.mean() == pytest.approx(1.0 / (1.0 + depth**2), abs=0.006)
    assert np.abs(found - found.mean()).max() < SHARE_NOISE


def test_a_plate_over_the_ground_takes_its_share_of_the_sky_from_it() -> None:
    """Closed form below the middle: 1 − R²/(R² + h²), which no fading touches; nothing at the grid's border."""
    turn = np.arange(180) * 2.0 * np.pi / 180
    vertices = np.stack([800.0 * np.cos(turn), 800.0 * np.sin(turn), np.full(180, 500.0)], axis=1)
    vertices = np.concatenate([[[0.0, 0, 500]], vertices])
    k = np.arange(180) + 1
    faces = np.stack([np.zeros(180, dtype=int), k, k % 180 + 1], axis=1)
    shadow = contact(TriangleScene(vertices, faces), vertices)
    assert shadow is not None
    i, j = (round(-shadow.origin[k] / (shadow.along[0] if k == 0 else shadow.across[1])) for k in range(2))
    assert shadow.sky[i - 1:i + 2, j - 1:j + 2].mean() == pytest.approx(1.0 - 0.64 / (0.64 + 0.25), abs=0.02)
    border = np.concatenate([shadow.sky[0], shadow.sky[-1], shadow.sky[:, 0], shadow.sky[:, -1]])
    assert (border == 1.0).all()


def test_a_convex_body_sees_all_around_it_and_darkens_the_ground_below() -> None:
    vertices, faces = box(6)
    body = body_of(1000.0 * vertices + [0.0, 0.0, 700.0], faces, GRAY)
    assert (body.sky == 1.0).all()
    assert body.contact is not None
    assert body.contact.sky.min() < 0.2


def test_a_town_gets_no_contact_shadow_and_a_mesh_of_many_vertices_is_not_baked(monkeypatch: pytest.MonkeyPatch) -> None:
    x, y, faces = grid(np.linspace(-4e5, 4e5, 40), np.linspace(-4e5, 4e5, 40))
    town = body_of(np.stack([x, y, 300.0 + 2e4 * np.sin(x / 3e4) ** 2], axis=1), faces, GRAY)
    assert town.contact is None
    assert town.sky.min() < 0.9
    monkeypatch.setattr(bodies, "MAX_SHADED", 100)
    assert (body_of(np.stack([x, y, 2e4 * np.sin(x / 3e4) ** 2], axis=1), faces, GRAY).sky == 1.0).all()


# What is wrong with a file, and what is said about it.


def broken_glb(change: Callable[[Glb], None]) -> bytes:
    file = Glb()
    picture = file.texture(png(np.zeros((2, 2, 3), dtype=np.uint8)))
    file.mesh(*car(), material={"pbrMetallicRoughness": {"baseColorTexture": {"index": picture}}})
    change(file)
    return file.bytes()


def not_finite(file: Glb) -> None:
    vertices, faces = car()
    vertices[3] = np.nan
    file.tree["meshes"] = []
    file.mesh(vertices, faces)


def bad_index(file: Glb) -> None:
    file.tree["meshes"] = []
    file.mesh(car()[0], np.array([[0, 1, 999]]))


def no_faces(file: Glb) -> None:
    file.tree["meshes"][0]["primitives"][0]["mode"] = 1


def flat(file: Glb) -> None:
    file.tree["meshes"] = []
    file.mesh(car()[0], np.array([[0, 0, 1]]))


def set_to(*path: Any, value: Any) -> Callable[[Glb], None]:
    def change(file: Glb) -> None:
        at = file.tree
        for key in path[:-1]:
            at = at[key]
        at[path[-1]] = value

    return change


@pytest.mark.parametrize(("change", "message"), [
    (not_finite, "has a corner that is not finite"),
    (bad_index, "names vertex 999 of 26"),
    (no_faces, "holds no triangles"),
    (flat, "none of its triangles has an area"),
    (set_to("meshes", value=[]), "not a readable glTF file"),
    (set_to("nodes", value=[]), "not a readable glTF file"),
    (set_to("asset", value={"version": "1.0"}), r"not a glTF 2 file \(asset\.version\)"),
    (set_to("extensionsRequired", value=["KHR_draco_mesh_compression"]), "needs the glTF extension KHR_draco_mesh_compression"),
    (set_to("nodes", value=[{"children": [0]}]), "nodes hang on themselves"),
    (set_to("accessors", 0, "count", value=10**6), "accessor 0 reaches beyond its buffer: is the file cut short"),
    (set_to("accessors", 0, "count", value=-3), "accessor 0 has an impossible place or count"),
    (set_to("accessors", 0, "sparse", value={}), "accessor 0 is sparse"),
    (set_to("accessors", 0, "componentType", value=7), "not a readable glTF file"),
    (set_to("bufferViews", 0, "byteLength", value=10**7), "buffer 0 is shorter than its views"),
    (set_to("images", 0, value={"uri": "plate.png"}), "its picture 'plate.png' cannot be read: No such file or directory"),
    (set_to("images", 0, value={"uri": "data:image/png;base64,####"}), "a picture inside it is not readable"),
    (set_to("images", 0, value={"uri": "data:image/png;base64,AAAA"}), "picture 0: not a picture in a format that is read"),
    (set_to("textures", 0, value={"extensions": {}}), "a texture is in a format that is not read"),
    (set_to("nodes", 0, "scale", value=[1e-3, 1e-3, 1e-3]), r"it is 4\.4 mm across, .*glTF is in metres: scale the model"),
    (set_to("nodes", 0, "scale", value=[2e3, 2e3, 2e3]), r"it is 8\.8e\+06 mm across, .*was it written in mm"),
    (set_to("meshes", 0, "extras", value={"ground": {"x0": 0}}), "extras.ground is no grid of shares"),
    (set_to("meshes", 0, "extras", value={"ground": {"x0": 0, "dx": 1, "nx": 1, "y0": 0, "dy": 1, "ny": 2, "sky": [0, 9]}}),
     "extras.ground is no grid of shares from 0 to 1"),
])
def test_a_gltf_that_cannot_be_used_is_refused(tmp_path: Path, change: Callable[[Glb], None], message: str) -> None:
    path = tmp_path / "broken.glb"
    path.write_bytes(broken_glb(change))
    with pytest.raises(FileError, match=message) as refused:
        read_body(path)
    assert str(path) in str(refused.value)


@pytest.mark.parametrize(("name", "data", "message"), [
    ("a.glb", b"", "not a readable glTF file"),
    ("a.glb", b"hello, I am no mesh", "not a readable glTF file"),
    ("a.glb", b"glTF" + (1).to_bytes(4, "little") + (20).to_bytes(4, "little"), "glTF 1; 2 is read"),
    ("a.gltf", b"{", "not a readable glTF file"),
    ("a.gltf", b"[]", "not a glTF 2 file"),
    ("a.stl", b"", "holds no triangles"), ("a.stl", b"solid x\nendsolid x\n", "holds no triangles|not a readable STL"),
    ("a.stl", b"\0" * 80 + (7).to_bytes(4, "little") + b"\0" * 100, "holds 2 of the 7 triangles that its header names"),
    ("a.obj", b"v 0 0 0\nv 1 0 0\n", "OBJ|no triangles"), ("a.obj", b"\x00\x01\x02", "OBJ|no triangles"),
    ("a.obj", b"v 0 0 0\nv nan 0 0\nv 0 900 0\nf 1 2 3\n", "has a corner that is not finite"),
    ("a.obj", b"mtllib none.mtl\nv 0 0 0\nv 900 0 0\nv 0 900 0\nf 1 2 3\n", "its material file 'none.mtl' cannot be read"),
    ("a.ply", b"ply\nformat ascii 1.0\n", "PLY"),
    ("a.off", b"OFF\n3 1 0\n0 0 0\n", "OFF|cut short"),
])
def test_other_files_that_cannot_be_used_are_refused(tmp_path: Path, name: str, data: bytes, message: str) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(FileError, match=message):
        read_body(tmp_path / name)


def test_a_file_cut_short_a_missing_one_and_one_of_another_kind_are_refused(tmp_path: Path) -> None:
    path = simple(tmp_path / "car.glb")
    data = path.read_bytes()
    for length in (11, 20, 200, len(data) - 1):
        path.write_bytes(data[:length])
        with pytest.raises(FileError):
            read_body(path)
    with pytest.raises(FileError, match="none.glb: cannot be read: no such file"):
        read_body(tmp_path / "none.glb")
    for name in ("car.step", "car"):
        with pytest.raises(SceneError, match=r"a body is read from \.glb, \.gltf"):
            read_body(tmp_path / name)
    with pytest.raises(SceneError, match="unit 'yard' is none of mm, cm, m, inch, foot"):
        read_body(path, unit="yard")
    with pytest.raises(SceneError, match="glTF is in metres by its standard"):
        read_body(path, unit="mm")


def test_a_missing_picture_of_an_obj_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.mtl").write_text("newmtl a\nmap_Kd gone.png\n")
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nv 0 0 0\nv 900 0 0\nv 0 900 0\nvt 0 0\nusemtl a\nf 1/1 2/1 3/1\n")
    with pytest.raises(FileError, match=r"its picture 'gone\.png' cannot be read"):
        read_body(tmp_path / "a.obj")
    (tmp_path / "gone.png").write_bytes(b"no picture")
    with pytest.raises(FileError, match=r"gone\.png"):
        read_body(tmp_path / "a.obj")


def test_ten_million_triangles_are_refused_before_they_are_read(tmp_path: Path) -> None:
    path = tmp_path / "huge.stl"
    path.write_bytes(b"\0" * 80 + (10_000_000).to_bytes(4, "little"))
    os.truncate(path, 84 + 50 * 10_000_000)  # holes take no room on the disc
    with pytest.raises(FileError, match="10000000 triangles are more than 5000000: reduce the mesh"):
        read_body(path)


def test_too_many_triangles_of_a_gltf_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bodies, "MAX_TRIANGLES", 40)
    with pytest.raises(FileError, match="48 triangles are more than 40: reduce the mesh"):
        read_body(simple(tmp_path / "car.glb"))


def test_a_gltf_with_its_data_beside_or_inside_it_is_the_same_body(tmp_path: Path) -> None:
    file = Glb().mesh(*car())
    tree = {key: value for key, value in file.tree.items() if value != []}
    (tmp_path / "some data.bin").write_bytes(file.binary)
    inside = "data:application/octet-stream;base64," + base64.b64encode(file.binary).decode()
    first = read_body(file.write(tmp_path / "car.glb"))
    for uri in ("some%20data.bin", inside):
        (tmp_path / "car.gltf").write_text(json.dumps(tree | {"buffers": [{"byteLength": len(file.binary), "uri": uri}]}))
        assert np.array_equal(read_body(tmp_path / "car.gltf").vertices, first.vertices)
    (tmp_path / "some data.bin").unlink()
    (tmp_path / "car.gltf").write_text(json.dumps(tree | {"buffers": [{"byteLength": 9, "uri": "some%20data.bin"}]}))
    with pytest.raises(FileError, match="its buffer 'some data.bin' cannot be read"):
        read_body(tmp_path / "car.gltf")


@pytest.mark.parametrize(("position", "heading"), [((0.0, 0.0), 0.0), ((0.0, np.nan, 0.0), 0.0), ((0.0, 0.0, 0.0), np.inf)])
def test_a_body_cannot_be_placed_nowhere(position: tuple[float, ...], heading: float) -> None:
    body = body_of(np.array([[0.0, 0, 0], [900.0, 0, 0], [0, 900.0, 0]]), FACE, GRAY)
    with pytest.raises(SceneError, match="a body is placed at three finite numbers"):
        body.placed(position, heading)


@pytest.mark.parametrize(("change", "message"), [
    ({"diffuse": (0.5, 1.5, 0.5)}, "diffuse .* must lie from 0 to 1"), ({"roughness": float("nan")}, "roughness"),
    ({"specular": (-0.1, 0.0, 0.0)}, "specular"), ({"texture": np.zeros((4, 4), dtype=np.uint8)}, r"not \(4, 4\) of uint8"),
    ({"texture": np.zeros((4, 4, 3))}, "float64"), ({"texture": np.zeros((0, 4, 3), dtype=np.uint8)}, r"\(0, 4, 3\)"),
])
def test_a_material_that_reflects_more_than_it_gets_is_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        Material(**({"name": "m", "diffuse": (0.5, 0.5, 0.5)} | change))
