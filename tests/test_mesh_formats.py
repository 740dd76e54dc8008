"""What OBJ, PLY and OFF files of other programs say beside plain triangles: all that is legal in them is read."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mirror_cad.errors import FileError
from raytrace.mesh_files import read_mesh
from raytrace.scene.bodies import Body, read_body
from raytrace.scene.materials import linear

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 0 1\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
RED = (200, 0, 0)


def body_of_text(tmp_path: Path, text: str, name: str = "a.obj") -> Body:
    (tmp_path / name).write_bytes(text.encode())
    return read_body(tmp_path / name, unit="m")


def red_picture(path: Path) -> None:
    path.parent.mkdir(exist_ok=True, parents=True)
    Image.new("RGB", (2, 2), RED).save(path)


def area(body: Body) -> float:
    corner = body.vertices[body.faces]
    return 0.5e-6 * float(np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1).sum())


def colour_at(body: Body, x: float, z: float) -> list[float]:
    """The mean colour of the vertices at a place of the square, linear."""
    assert body.colours is not None
    at = (np.abs(body.vertices[:, [0, 2]] / 1000.0 - [x, z]) < 1e-9).all(axis=1)
    return body.colours[at, :3].mean(axis=0).tolist()


@pytest.mark.parametrize("faces", [
    "f 1/1 2/2 3/3 4/4\n", "f -4/-4 -3/-3 -2/-2 -1/-1\n",  # counted back
    "f 1/1 2/2 \\\n 3/3 4/4\n", "f 1/1 2/2 3/3 4/4 # a wall\n", "f\t1/1\t2/2 3/3\t 4/4  \n", "fo 1/1 2/2 3/3 4/4\n",
    "vn 0 1 0\nf 1/1/1 2/2/1 3/3/1 4/4/1\n", "vn 0 1 0\nf 1/1/-1 2/2/-1 3/3/-1 -1/-1/-1\n",
    "f 1/1 2/2 3/3\nf 1/1 3/3 4/4\nf 1\nf 1 2\nl 1 2 3\np 4\n",  # lines and points beside it
    "g side\ns 1\no wall\nf 1/1 2/2 3/3 4/4\n", "f 1/1 2/2 3/3\nv 9 9 9\nvt 0 0\nf -5/-5 -3/-3 -2/-2\n"])
@pytest.mark.parametrize("ends", ["\n", "\r\n", "\r"])
def test_faces_of_an_obj_are_read_however_they_are_written(tmp_path: Path, faces: str, ends: str) -> None:
    body = body_of_text(tmp_path, "\ufeff" * (ends == "\r\n") + (SQUARE + faces).replace("\n", ends))
    assert area(body) == pytest.approx(1.0, rel=1e-12)
    corners = {(round(x / 1000.0), round(z / 1000.0), u, v) for (x, _, z), (u, v) in zip(body.vertices, body.uv, strict=True)}
    assert corners == {(0, 0, 0.0, 1.0), (1, 0, 1.0, 1.0), (1, 1, 1.0, 0.0), (0, 1, 0.0, 0.0)}


def test_corners_with_and_without_texture_coordinates_in_one_file_are_read(tmp_path: Path) -> None:
    body = body_of_text(tmp_path, SQUARE + "vn 0 1 0\nf 1/1 2//1 3/3/1\nf 1 3 4\n")
    assert area(body) == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize(("library", "line"), [
    ("wall.mtl", "mtllib wall.mtl\n"), ("wall.mtl", "mtllib other.mtl wall.mtl\n"), ("wall.mtl", 'mtllib "wall.mtl"\n'),
    ("the wall.mtl", "mtllib the wall.mtl\n"), ("the wall.mtl", 'mtllib other.mtl "the wall.mtl"\n'),
    ("wall.mtl", "mtllib other.mtl\nmtllib wall.mtl\n"), ("sub/wall.mtl", "mtllib sub\\wall.mtl\n"),
    ("wall.mtl", "mtllib .\\wall.mtl\n"), ("Wall.MTL", "mtllib wall.mtl\n"), ("wall.mtl", "mtllib C:\\work\\wall.mtl\n")])
def test_the_material_files_of_an_obj_are_found(tmp_path: Path, library: str, line: str) -> None:
    """Several, with blanks, quoted, in folders as Windows writes them, in another case, by a path of another machine."""
    (tmp_path / "other.mtl").write_text("newmtl b\nKd 0 0 1\n")
    (tmp_path / library).parent.mkdir(exist_ok=True)
    (tmp_path / library).write_text("newmtl a\nKd 0.25 0.5 0.75\n")
    body = body_of_text(tmp_path, line + SQUARE + "usemtl a\nf 1/1 2/2 3/3 4/4\n")
    assert [m.diffuse for m in body.materials] == [(0.25, 0.5, 0.75)]


@pytest.mark.parametrize("name", [
    "textures/red.png", "textures\\red.png", "textures\\\\red.png", "TEXTURES/Red.PNG", "red one.png", '"red one.png"',
    "D:\\models\\red one.png", "-clamp on textures/red.png", "-s 1 1 1 textures/red.png", "-s 1 textures/red.png",
    "-bm 1.0 -o 0 0 0 -mm 0 1 textures\\red.png", "-type sphere -imfchan r -blendu off textures/red.png"])
def test_the_picture_of_a_material_is_found_behind_its_options(tmp_path: Path, name: str) -> None:
    red_picture(tmp_path / "textures" / "red.png")
    red_picture(tmp_path / "red one.png")
    (tmp_path / "wall.mtl").write_text(f"newmtl a\nmap_Kd {name}\n")
    body = body_of_text(tmp_path, "mtllib wall.mtl\n" + SQUARE + "usemtl a\nf 1/1 2/2 3/3 4/4\n")
    assert body.materials[0].texture is not None
    assert (body.materials[0].texture == RED).all()
    assert body.materials[0].diffuse == (1.0, 1.0, 1.0)
    assert body.uv.min() == 0.0
    assert body.uv.max() == 1.0


def test_a_map_s_scale_and_offset_move_its_picture(tmp_path: Path) -> None:
    """-s 2 3 -o 0.25 0.5: u = 2·u + 0.25, and v, upwards, 3·v + 0.5."""
    red_picture(tmp_path / "red.png")
    (tmp_path / "wall.mtl").write_text("newmtl a\nmap_Kd -s 2 3 1 -o 0.25 0.5 red.png\n")
    body = body_of_text(tmp_path, "mtllib wall.mtl\n" + SQUARE + "usemtl a\nf 1/1 2/2 3/3 4/4\n")
    for (x, _, z), (u, v) in zip(body.vertices / 1000.0, body.uv, strict=True):
        assert u == pytest.approx(2.0 * x + 0.25)
        assert 1.0 - v == pytest.approx(3.0 * z + 0.5)


def test_what_a_material_covers_is_read_and_what_is_not_drawn_is_said(tmp_path: Path) -> None:
    leaf = np.zeros((4, 4, 4), dtype=np.uint8)
    leaf[:2, :, 1], leaf[:2, :, 3] = 200, 255
    Image.fromarray(leaf).save(tmp_path / "leaf.png")
    (tmp_path / "a.mtl").write_text(
        "newmtl glass\nKd 0.1 0.1 0.1\nd 0.25\nnewmtl dim\nTr 0.25\nnewmtl leaf\nmap_Kd leaf.png\nmap_d leaf.png\n"
        "newmtl bark\nmap_Kd leaf.png\nmap_Bump leaf.png\n")
    faces = "".join(f"usemtl {name}\nf 1/1 2/2 3/3 4/4\n" for name in ("glass", "dim", "leaf", "bark", "unknown"))
    body = body_of_text(tmp_path, "mtllib a.mtl\n" + SQUARE + faces)
    made = {m.name: m for m in body.materials}
    assert (made["glass"].opacity, made["dim"].opacity) == (0.25, 0.75)
    assert made["leaf"].cutoff == 0.5
    assert made["leaf"].cover is not None
    assert np.array_equal(made["leaf"].cover, leaf[..., 3])
    assert made["bark"].whole
    assert body.left_out == ("a.obj: left out: bump maps, materials that no file of its own describes (unknown), transparency "
                             "of pictures without map_d")


def test_texture_coordinates_without_a_material_are_a_light_gray_matt_body(tmp_path: Path) -> None:
    """The case as it was met, as OBJ and as Blender writes PLY."""
    ply = ("ply\nformat ascii 1.0\ncomment as Blender writes it\nelement vertex 4\nproperty float x\nproperty float y\n"
           "property float z\nproperty float s\nproperty float t\nelement face 1\nproperty list uchar uint vertex_indices\n"
           "end_header\n0 0 0 0 0\n1 0 0 1 0\n1 0 1 1 1\n0 0 1 0 1\n4 0 1 2 3\n")
    for name, text in (("a.obj", SQUARE + "f 1/1 2/2 3/3 4/4\n"), ("a.ply", ply),
                       ("b.ply", ply.replace("float s", "float texture_u").replace("float t\n", "float texture_v\n"))):
        body = body_of_text(tmp_path, text, name)
        assert [(m.diffuse, m.roughness, m.texture) for m in body.materials] == [((0.5, 0.5, 0.5), 1.0, None)]
        assert area(body) == pytest.approx(1.0, rel=1e-6)
        assert sorted(map(tuple, body.uv.tolist())) == [(0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0)]


PLY_SQUARE = ((0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1))
FOUR = ((255, 0, 0), (0, 255, 0), (0, 0, 255), (188, 188, 188))


def coloured(tmp_path: Path) -> dict[str, Path]:
    """One square with a colour a corner, in every form that is met."""
    rows = [(*place, *colour) for place, colour in zip(PLY_SQUARE, FOUR, strict=True)]
    header = "element vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    rgb = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    shares = "".join(f"property float {name}\n" for name in ("red", "green", "blue"))
    face = "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    text = "".join(" ".join(map(str, row)) + "\n" for row in rows) + "4 0 1 2 3\n"
    floats = "".join(" ".join(map(str, (*row[:3], *(v / 255.0 for v in row[3:])))) + "\n" for row in rows) + "4 0 1 2 3\n"
    binary = b"".join(struct.pack("<3f3B", *row) for row in rows) + struct.pack("<B4i", 4, 0, 1, 2, 3)
    # A face that is not like the first, and what no reader knows, before it.
    odd_header = ("element strange 2\nproperty list uchar double what\nproperty short ever\n"
                  "element face 2\nproperty list uchar int vertex_indices\nend_header\n")
    odd = (b"".join(struct.pack(">3f3B", *row) for row in rows) + struct.pack(">B2dh", 2, 1.0, 2.0, 7)
           + struct.pack(">Bh", 0, 9) + struct.pack(">B4i", 4, 0, 1, 2, 3) + struct.pack(">B3i", 3, 0, 1, 2))
    off_rows = "".join(" ".join(map(str, (*row, 255))) + "\n" for row in rows)
    off_floats = "".join(" ".join(str(v) for v in (*row[:3], *(v / 255.0 for v in row[3:]), 1.0)) + "\n" for row in rows)
    files = {
        "text.ply": f"ply\nformat ascii 1.0\n{header}{rgb}{face}{text}".encode(),
        "diffuse.ply": f"ply\nformat ascii 1.0\n{header}{rgb}{face}{text}".replace("uchar red", "uchar diffuse_red").replace(
            "uchar green", "uchar diffuse_green").replace("uchar blue", "uchar diffuse_blue").encode(),
        "shares.ply": f"ply\nformat ascii 1.0\n{header}{shares}{face}{floats}".encode(),
        "windows.ply": f"ply\nformat ascii 1.0\n{header}{rgb}{face}{text}".replace("\n", "\r\n").encode(),
        "binary.ply": f"ply\nformat binary_little_endian 1.0\n{header}{rgb}{face}".encode() + binary,
        "odd.ply": f"ply\nformat binary_big_endian 1.0\n{header}{rgb}{odd_header}".encode() + odd,
        "a.off": f"COFF\n4 1 4\n{off_rows}4 0 1 2 3\n".encode(),
        "shares.off": f"COFF # with colours\n\n4 1 4\n# places\n{off_floats}4 0 1 2 3\n".encode(),
        "a.obj": ("".join("v " + " ".join(str(v) for v in (*row[:3], *(v / 255.0 for v in row[3:]))) + "\n" for row in rows)
                  + "f 1 2 3 4\n").encode(),
    }
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
    return {name: tmp_path / name for name in files}


def test_colours_of_vertices_are_read_in_every_form(tmp_path: Path) -> None:
    """0 to 255 or shares of 1; they are sRGB, and the body's light gray is no part of them."""
    for name, path in coloured(tmp_path).items():
        body = read_body(path, unit="m")
        assert [m.diffuse for m in body.materials] == [(1.0, 1.0, 1.0)], name
        for (x, _, z), colour in zip(PLY_SQUARE, FOUR, strict=True):
            assert colour_at(body, x, z) == pytest.approx(linear(np.array(colour)), abs=1e-6), name


def test_colours_of_faces_are_read(tmp_path: Path) -> None:
    """Two triangles of two colours keep a sharp edge between them."""
    ply = ("ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 2\n"
           "property list uchar int vertex_indices\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
           "0 0 0\n1 0 0\n1 0 1\n0 0 1\n3 0 1 2 255 0 0\n3 0 2 3 0 0 255\n")
    off = "OFF\n4 2 0\n0 0 0\n1 0 0\n1 0 1\n0 0 1\n3 0 1 2 255 0 0\n3 0 2 3 0.0 0.0 1.0 1.0\n".replace("255 0 0", "1.0 0.0 0.0")
    for name, text in (("a.ply", ply), ("a.off", off)):
        body = body_of_text(tmp_path, text, name)
        assert body.colours is not None
        assert len(body.vertices) == 6
        for face in body.faces:
            assert (body.colours[face] == body.colours[face[0]]).all()
        assert {tuple(row) for row in body.colours.tolist()} == {(1.0, 0.0, 0.0, 1.0), (0.0, 0.0, 1.0, 1.0)}


def test_normals_and_texture_coordinates_of_an_off_are_stepped_over_or_read(tmp_path: Path) -> None:
    off = "".join(f"{x} {y} {z} 0 -1 0 {FOUR[k][0]} {FOUR[k][1]} {FOUR[k][2]} 255 {x} {z}\n" for k, (x, y, z) in
                  enumerate(PLY_SQUARE))
    body = body_of_text(tmp_path, f"STCNOFF 4 1 4\n{off}4 0 1 2 3\n", "a.off")
    assert colour_at(body, 1, 0) == pytest.approx([0.0, 1.0, 0.0], abs=1e-9)
    assert sorted(map(tuple, body.uv.tolist())) == [(0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0)]
    for header, message in (("4OFF", "four or more coordinates"), ("nOFF", "four or more coordinates"),
                            ("OFF BINARY", "a binary OFF file is not read: export as text"),
                            ("OUF", "does not begin with OFF")):
        (tmp_path / "b.off").write_text(f"{header}\n4 1 0\n")
        with pytest.raises(FileError, match=message):
            read_mesh(tmp_path / "b.off")


def test_strips_and_texture_files_of_a_ply_are_read(tmp_path: Path) -> None:
    """Stanford's strips, parted by −1, turn every second triangle; MeshLab names a texture in a comment."""
    red_picture(tmp_path / "red.png")
    strips = ("ply\nformat ascii 1.0\ncomment TextureFile red.png\nelement vertex 6\nproperty float x\nproperty float y\n"
              "property float z\nproperty float texture_u\nproperty float texture_v\nelement tristrips 1\n"
              "property list int int vertex_indices\nend_header\n"
              "0 0 0 0 0\n1 0 0 1 0\n0 0 1 0 1\n1 0 1 1 1\n0 0 2 0 2\n1 0 2 1 2\n"
              "9 0 1 2 3 4 -1 3 5 4\n")
    body = body_of_text(tmp_path, strips, "a.ply")
    assert area(body) == pytest.approx(2.0, rel=1e-12)
    assert len(body.faces) == 4
    facets = np.cross(body.vertices[body.faces[:, 1]] - body.vertices[body.faces[:, 0]],
                      body.vertices[body.faces[:, 2]] - body.vertices[body.faces[:, 0]])
    assert (facets[:, 1] < 0.0).all()
    assert body.materials[0].texture is not None
    by_face = ("ply\nformat ascii 1.0\ncomment TextureFile red.png\nelement vertex 3\nproperty float x\nproperty float y\n"
               "property float z\nelement face 1\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\n"
               "end_header\n0 0 0\n1 0 0\n0 0 1\n3 0 1 2 6 0 0 0.5 0 0 0.5\n")
    body = body_of_text(tmp_path, by_face, "b.ply")
    assert sorted(map(tuple, body.uv.tolist())) == [(0.0, 0.5), (0.0, 1.0), (0.5, 1.0)]


@pytest.mark.parametrize(("name", "text", "message"), [
    ("a.obj", "v 0 0 0\nv 1 0,5 0\nv 0 1 0\nf 1 2 3\n", r"line 2: '0,5' is no number"),
    ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 x\n", r"line 4: 'x' is no number"),
    ("a.obj", SQUARE + "f 1/1 2/2 3/9\n", "line 9: a face names texture coordinate 9 of 4"),
    ("a.obj", SQUARE + "f 1 2 -5\n", "line 9: a face names vertex -5 of 4"),
    ("a.ply", "ply\nformat ascii 2 1.0\nelement vertex x\n", "no header from 'ply' to 'end_header'"),
    ("a.ply", "ply\nformat acsii 1.0\nend_header\n", "its header has the line 'format acsii 1.0'"),
    ("a.ply", "ply\nformat ascii 1.0\nelement vertex -3\nend_header\n", "names -3 entries of 'vertex'"),
    ("a.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nend_header\n0 0\n",
     "its vertices have 2 coordinates, three are needed"),
    ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1\n3 0 1 2\n", "vertex 2 has 2 numbers, 3 are needed"),
    ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1\n", "face 0 names 2 of its 3 vertices"),
    ("a.off", "OFF\n3 -1 0\n", "names 3 vertices and -1 faces")])
def test_what_cannot_be_read_is_named_with_its_place(tmp_path: Path, name: str, text: str, message: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(FileError, match=message):
        read_body(tmp_path / name)
