"""Meshes as mirrors: files of other programs, and normals between the facets."""

from __future__ import annotations

import json
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from mirror_cad.errors import FileError, MirrorError
from mirror_cad.mesh import SurfaceMesh
from mirror_cad.stl_file import read_stl
from raytrace import mesh_files
from raytrace.embree import TriangleScene
from raytrace.errors import TraceError
from raytrace.kernels.mesh_normals import corner_normals, interpolated_normals
from raytrace.mesh_files import read_mesh
from raytrace.viewing.eye import eye_position
from tests.conftest import designed
from tests.meshes import box, cap, icosphere, unit

ARCSEC = np.degrees(1.0) * 3600.0
EYE = eye_position(762.0, "right", (-115.0, 115.0, -163.45, 163.45))


def arcsec(normals: np.ndarray, exact: np.ndarray) -> np.ndarray:
    """Angles between unit vectors."""
    return 2.0 * np.arcsin(0.5 * np.linalg.norm(normals - exact, axis=-1)) * ARCSEC


def same_mesh(a: SurfaceMesh, b: SurfaceMesh) -> bool:
    """Whether two meshes have the same triangles, whatever the order of vertices and triangles."""
    def triangles(mesh: SurfaceMesh) -> np.ndarray:
        corners = mesh.vertices[mesh.faces]
        first = np.lexsort(np.moveaxis(corners, 2, 0)[::-1])[:, 0]
        turned = corners[np.arange(len(corners))[:, None], (first[:, None] + np.arange(3)) % 3].reshape(-1, 9)
        return turned[np.lexsort(turned.T[::-1])]

    return a.faces.shape == b.faces.shape and np.array_equal(triangles(a), triangles(b))


# Files written out here, so that the reader is not tested against its own program's writer.

def obj(mesh: SurfaceMesh) -> bytes:
    return "".join([f"v {x!r} {y!r} {z!r}\n" for x, y, z in mesh.vertices.tolist()]
                   + [f"f {a} {b} {c}\n" for a, b, c in (mesh.faces + 1).tolist()]).encode()


def off(mesh: SurfaceMesh) -> bytes:
    return (f"OFF\n{len(mesh.vertices)} {len(mesh.faces)} 0\n"
            + "".join([f"{x!r} {y!r} {z!r}\n" for x, y, z in mesh.vertices.tolist()]
                      + [f"3 {a} {b} {c}\n" for a, b, c in mesh.faces.tolist()])).encode()


def ply_header(mesh: SurfaceMesh, form: str) -> bytes:
    return (f"ply\nformat {form} 1.0\nelement vertex {len(mesh.vertices)}\nproperty double x\nproperty double y\n"
            f"property double z\nelement face {len(mesh.faces)}\nproperty list uchar int vertex_indices\nend_header\n").encode()


def ascii_ply(mesh: SurfaceMesh) -> bytes:
    return ply_header(mesh, "ascii") + off(mesh).split(b" 0\n", 1)[1]


def binary_ply(mesh: SurfaceMesh) -> bytes:
    return (ply_header(mesh, "binary_little_endian") + mesh.vertices.astype("<f8").tobytes()
            + b"".join(struct.pack("<B3i", 3, *face) for face in mesh.faces.tolist()))


def gltf_parts(mesh: SurfaceMesh) -> tuple[dict[str, object], bytes]:
    """The JSON and the buffer of a glTF file whose only node is scaled by 1/1000, so that mm in it are mm."""
    places, faces = mesh.vertices.astype("<f4").tobytes(), mesh.faces.astype("<u4").tobytes()
    low, high = mesh.vertices.min(axis=0).tolist(), mesh.vertices.max(axis=0).tolist()
    return {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0, "scale": [1e-3] * 3}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(mesh.vertices), "type": "VEC3", "min": low, "max": high},
            {"bufferView": 1, "componentType": 5125, "count": mesh.faces.size, "type": "SCALAR"}],
        "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": len(places)},
                        {"buffer": 0, "byteOffset": len(places), "byteLength": len(faces)}],
        "buffers": [{"byteLength": len(places) + len(faces)}],
    }, places + faces


def glb(mesh: SurfaceMesh) -> bytes:
    tree, buffer = gltf_parts(mesh)
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    return (struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(buffer)) + struct.pack("<I4s", len(text), b"JSON") + text
            + struct.pack("<I4s", len(buffer), b"BIN\0") + buffer)


def write_gltf(path: Path, mesh: SurfaceMesh) -> None:
    tree, buffer = gltf_parts(mesh)
    path.with_suffix(".bin").write_bytes(buffer)
    path.write_text(json.dumps({**tree, "buffers": [{"byteLength": len(buffer), "uri": path.with_suffix(".bin").name}]}))


def write_3mf(path: Path, mesh: SurfaceMesh, unit_name: str) -> None:
    vertices = "".join(f'<vertex x="{x!r}" y="{y!r}" z="{z!r}"/>' for x, y, z in mesh.vertices.tolist())
    faces = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in mesh.faces.tolist())
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("3D/3dmodel.model", (
            f'<model unit="{unit_name}" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources>'
            f'<object id="1" type="model"><mesh><vertices>{vertices}</vertices><triangles>{faces}</triangles></mesh></object>'
            '</resources><build><item objectid="1"/></build></model>'))


@pytest.mark.parametrize(("name", "write"), [("a.obj", obj), ("a.off", off), ("a.ply", ascii_ply), ("a.ply", binary_ply)])
def test_text_and_binary_files_are_read_in_float64(name: str, write: Callable[[SurfaceMesh], bytes], tmp_path: Path) -> None:
    vertices, faces, _ = cap(9)
    mesh = SurfaceMesh(vertices, faces)
    (tmp_path / name).write_bytes(write(mesh))
    assert same_mesh(read_mesh(tmp_path / name), mesh)


def test_gltf_metres_become_mm_and_its_nodes_are_placed(tmp_path: Path) -> None:
    vertices, faces, _ = cap(9)
    mesh = SurfaceMesh(vertices.astype(np.float32).astype(np.float64), faces)
    (tmp_path / "a.glb").write_bytes(glb(mesh))
    write_gltf(tmp_path / "b.gltf", mesh)
    for name in ("a.glb", "b.gltf"):
        read = read_mesh(tmp_path / name)
        assert read.faces.shape == mesh.faces.shape
        # Written as mm under a scale of 1/1000, read as metres; 0.001 and 1000 are no powers of two.
        order, other = (np.lexsort(m.vertices.round(6).T) for m in (read, mesh))
        assert np.abs(read.vertices[order] - mesh.vertices[other]).max() < 1e-12


@pytest.mark.parametrize(("unit_name", "mm"), [("millimeter", 1.0), ("inch", 25.4), ("micron", 1e-3), ("meter", 1000.0)])
def test_3mf_is_in_the_unit_that_it_names(unit_name: str, mm: float, tmp_path: Path) -> None:
    vertices, faces, _ = cap(5)
    write_3mf(tmp_path / "a.3mf", SurfaceMesh(vertices, faces), unit_name)
    assert same_mesh(read_mesh(tmp_path / "a.3mf"), SurfaceMesh(vertices * mm, faces))


def test_corners_at_one_place_become_one_vertex_and_polygons_triangles(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv -0 -0 0\nv 1 1 0\nv 9 9 9\nvt 0 0\nf 1/1 2/1 3/1\nf 5/1 6/1 4/1\n")
    assert read_mesh(path).vertices.shape == (4, 3)
    path.write_text("v 0 0 0\nv 2 0 0\nv 3 1 0\nv 2 2 0\nv 0 2 0\nf 1 2 3 4 5\n")
    mesh = read_mesh(path)
    assert mesh.faces.shape == (3, 3)
    corners = mesh.vertices[mesh.faces]
    assert np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2].sum() / 2.0 == 5.0


PLY = ("ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
       "property list uchar int vertex_indices\nend_header\n")


@pytest.mark.parametrize(("name", "content", "message"), [
    ("a.obj", b"", "holds no triangles"),
    ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", "holds no triangles"),
    ("a.obj", bytes(range(256)) * 3, "holds no triangles"),
    ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "line 4: a face names vertex 9 of 3"),
    ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", "a face names vertex 0: vertices must be numbered from 1"),
    ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/1 2/2 -4/3\n", "line 4: a face names vertex -4 of 3"),
    ("a.obj", b"v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n", "face 0 has a corner that is not finite"),
    ("a.obj", b"v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n", "its vertices have 2 coordinates"),
    ("a.ply", b"", "not a readable PLY file"),
    ("a.ply", (PLY + "0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n").encode(), r"face 0 names vertices \[0, 1, 7\] of 3"),
    ("a.ply", (PLY + "0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n").encode(), r"face 0 names vertices \[0, 1, -1\] of 3"),
    ("a.ply", (PLY + "0 0 0\n1 0 0\n0 inf 0\n3 0 1 2\n").encode(), "face 0 has a corner that is not finite"),
    ("a.ply", PLY.replace("face 1", "face 2").encode() + b"0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
     "holds 1 of the 2 faces that its header names: is it cut short"),
    ("a.ply", PLY.replace("face 1", "face 2").encode() + b"0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n3 0 1",
     "holds 1 of the 2 faces"),
    ("a.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n", "holds 2 of the 4 lines that its header names"),
    ("a.off", b"OFF\n3 2 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "holds 4 of the 5 lines that its header names: is it cut short"),
    ("a.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 5\n", r"face 0 names vertices \[0, 1, 5\] of 3"),
    ("a.glb", b"", "not a readable glTF file"),
    ("a.glb", b"glTF" + bytes(60), "glTF 0; 2 is read"),
    ("a.gltf", b"{", r"not a readable glTF file \(Expecting property name"),
    ("a.gltf", b"{}", r"not a glTF 2 file \(asset.version\)"),
    ("a.gltf", b'{"asset": {"version": "2.0"}}', "holds no triangles"),
    ("a.3mf", b"PK", "not a readable 3MF file"),
])
def test_broken_files_are_refused_with_the_cause(name: str, content: bytes, message: str, tmp_path: Path) -> None:
    vertices, faces, _ = cap(3)
    write_gltf(tmp_path / "model.gltf", SurfaceMesh(vertices, faces))  # which trimesh takes for a glTF that is no JSON
    (tmp_path / name).write_bytes(content)
    with pytest.raises(FileError, match=rf"{name}: .*{message}"):
        read_mesh(tmp_path / name)


def test_files_that_are_none_of_its_own_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("a.stl", "a.xyz", "a"):
        with pytest.raises(TraceError, match=r"a mesh is read from \.obj, \.ply, \.off, \.gltf, \.glb, \.3mf, not from"):
            read_mesh(tmp_path / name)
    with pytest.raises(FileError, match="cannot be read: No such file"):
        read_mesh(tmp_path / "a.obj")
    (tmp_path / "b.obj").mkdir()
    with pytest.raises(FileError, match="cannot be read: Is a directory"):
        read_mesh(tmp_path / "b.obj")
    vertices, faces, _ = cap(3)
    (tmp_path / "c.obj").write_bytes(obj(SurfaceMesh(vertices, faces)))
    (tmp_path / "cut.glb").write_bytes(glb(SurfaceMesh(vertices, faces))[:-8])
    with pytest.raises(FileError, match="holds [0-9]+ of the [0-9]+ bytes that its header names: is it cut short"):
        read_mesh(tmp_path / "cut.glb")
    (tmp_path / "lost.gltf").write_text(json.dumps({**gltf_parts(SurfaceMesh(vertices, faces))[0],
                                                    "buffers": [{"byteLength": 9, "uri": "nowhere.bin"}]}))
    with pytest.raises(FileError, match=r"its buffer 'nowhere\.bin' cannot be read"):
        read_mesh(tmp_path / "lost.gltf")
    write_3mf(tmp_path / "d.3mf", SurfaceMesh(vertices, faces), "parsec")
    with pytest.raises(FileError, match="its unit 'parsec' is none of micron"):
        read_mesh(tmp_path / "d.3mf")
    monkeypatch.setattr(mesh_files, "MAX_TRIANGLES", 17)
    with pytest.raises(MirrorError, match=r"c\.obj: 18 triangles are more than 17: reduce the mesh"):
        read_mesh(tmp_path / "c.obj")


@pytest.mark.parametrize("uneven", [0.0, 0.3])
def test_interpolated_normals_of_a_sphere_converge_twice_as_fast_as_facets(uneven: float) -> None:
    """Through Embree, everywhere on an open sheet up to its rim, for regular and for irregular triangles."""
    x, y = np.meshgrid(np.linspace(-124.0, 124.0, 200), np.linspace(-189.0, 189.0, 300))
    directions = unit(np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) - EYE)
    from_facets, between = [], []
    for cells in (12, 24, 48):
        vertices, faces, _ = cap(cells, uneven)
        mesh = SurfaceMesh(vertices, faces)
        hits = TriangleScene(mesh.vertices, mesh.faces).first_hits(EYE, directions)
        hit = hits.triangle >= 0
        exact = unit((EYE + hits.distance[:, None] * directions)[hit] + [0.0, 0.0, 950.0])
        between.append(arcsec(interpolated_normals(corner_normals(mesh), hits.triangle, hits.u, hits.v)[hit], exact).max())
        from_facets.append(arcsec(mesh.facet_normals()[hits.triangle][hit], exact))
    orders = -np.diff(np.log2(between))
    assert (orders > 1.9).all(), (between, orders)
    orders = -np.diff(np.log2([np.sqrt(np.mean(error**2)) for error in from_facets]))
    assert orders == pytest.approx(1.0, abs=0.15)
    assert between[-1] < 0.01 * from_facets[-1].max()


def test_normals_of_a_closed_sphere_converge_and_few_neighbours_give_a_mean() -> None:
    errors = []
    for times in (3, 4, 5):
        vertices, faces = icosphere(times)
        errors.append(arcsec(corner_normals(SurfaceMesh(vertices, faces)), vertices[faces]).max())
    assert (-np.diff(np.log2(errors)) > 1.9).all(), errors
    # Four neighbours leave a quadric undetermined; the weights of the mean are exact on a sphere.
    fan = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
    fan[1:] = unit(fan[1:] + [0.0, 0, 4.0])
    mesh = SurfaceMesh(fan, np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]], dtype=np.int32))
    assert corner_normals(mesh)[0, 0] == pytest.approx([0.0, 0.0, 1.0], abs=1e-15)


def test_a_box_keeps_its_edges() -> None:
    mesh = SurfaceMesh(*box(4))
    corners = corner_normals(mesh)
    assert np.abs(corners - mesh.facet_normals()[:, None, :]).max() < 1e-12


def test_the_crease_angle_decides_what_is_one_surface() -> None:
    """Two strips that meet at 20° along x = 0."""
    y = np.linspace(-2.0, 2.0, 5)
    x = np.array([-2.0, -1, 0, 1, 2])
    xx, yy = np.meshgrid(x, y, indexing="ij")
    vertices = np.stack([xx.ravel(), yy.ravel(), -np.tan(np.radians(20.0)) * np.maximum(xx, 0.0).ravel()], axis=1)
    corner = np.arange(25).reshape(5, 5)[:-1, :-1].ravel()
    faces = np.concatenate([np.stack([corner, corner + 5, corner + 6], axis=1),
                            np.stack([corner, corner + 6, corner + 1], axis=1)]).astype(np.int32)
    mesh = SurfaceMesh(vertices, faces)
    assert np.abs(corner_normals(mesh, 15.0) - mesh.facet_normals()[:, None, :]).max() < 1e-12
    smooth = corner_normals(mesh, 25.0)[faces == 12]  # the vertex in the middle of the edge
    assert np.abs(smooth - smooth[0]).max() == 0.0
    assert arcsec(smooth[0], mesh.facet_normals()[0]) > 3600.0


def test_the_rim_of_a_plate_does_not_bend_its_mirror(tmp_path: Path) -> None:
    """An STL of a whole plate: near its edge the normals are those of the mirror's own face."""
    mirror = designed("progressive-c")
    mirror.export_stl(tmp_path / "c.stl")
    mesh = read_stl(tmp_path / "c.stl")
    on_sheet = np.abs(mesh.vertices[:, 2] - mirror.surface.evaluate(mesh.vertices[:, 0], mesh.vertices[:, 1])[:, 2]) < 1e-4
    front = on_sheet[mesh.faces].all(axis=1) & (mesh.facet_normals()[:, 2] > 0.5)
    places = mesh.vertices[mesh.faces[front]].reshape(-1, 3)
    slopes = mirror.surface.derivatives(places[:, 0], places[:, 1])
    exact = unit(np.cross(slopes["u"], slopes["v"]))
    error = arcsec(corner_normals(mesh)[front].reshape(-1, 3), exact)
    facet = arcsec(np.repeat(mesh.facet_normals()[front], 3, axis=0), exact)
    assert error.max() < 0.1 * facet.max()


def test_missed_rays_and_facets_without_area_have_no_normal() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]])
    corners = corner_normals(SurfaceMesh(vertices, np.array([[0, 1, 2], [0, 1, 3]], dtype=np.int32)))
    assert (corners[1] == 0.0).all()
    normals = interpolated_normals(corners, np.array([0, -1, 1], dtype=np.int32), np.full(3, 0.2), np.full(3, 0.3))
    assert normals.tolist() == [[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]


def test_the_mean_at_a_vertex_with_few_neighbours_is_exact_on_a_sphere_however_uneven_these_are() -> None:
    around = np.radians([0.0, 40.0, 130.0, 170.0, 290.0])
    aside = np.radians([3.0, 9.0, 5.0, 12.0, 4.0])
    ring = np.stack([np.sin(aside) * np.cos(around), np.sin(aside) * np.sin(around), np.cos(aside)], axis=1)
    vertices = 950.0 * np.concatenate([[[0.0, 0.0, 1.0]], ring])
    faces = np.array([[0, 1 + k, 1 + (k + 1) % 5] for k in range(5)], dtype=np.int32)
    assert np.abs(corner_normals(SurfaceMesh(vertices, faces))[:, 0] - [0.0, 0.0, 1.0]).max() < 1e-13


def test_a_facet_that_is_folded_over_another_is_another_surface() -> None:
    """Its normal is like the other's; that it is wound against it tells that it lies on the same side of what they share."""
    vertices = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.2, 0.9, 0.2]])
    mesh = SurfaceMesh(vertices, np.array([[0, 1, 2], [0, 1, 3]], dtype=np.int32))
    assert np.abs(corner_normals(mesh) - mesh.facet_normals()[:, None, :]).max() < 1e-15


def test_a_normal_is_that_of_the_weighted_quadric_through_its_vertex() -> None:
    """By least squares of another library, over the vertices that two sides lead to."""
    rng = np.random.default_rng(6)
    x, y = (each.ravel() for each in np.meshgrid(np.arange(9.0), np.arange(8.0), indexing="ij"))
    x, y = x + rng.uniform(-0.3, 0.3, x.size), y + rng.uniform(-0.3, 0.3, y.size)
    vertices = np.stack([x, y, 0.02 * x**2 - 0.03 * y**2 + 0.004 * x**3 + 0.3 * np.sin(0.7 * y)], axis=1)
    node = np.arange(72).reshape(9, 8)
    a, b, c, d = (each.ravel() for each in (node[:-1, :-1], node[1:, :-1], node[1:, 1:], node[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]).astype(np.int32)
    corners = corner_normals(SurfaceMesh(vertices, faces), 80.0)
    beside = [set(faces[(faces == k).any(axis=1)].ravel()) for k in range(72)]
    for i in node[2:-2, 2:-2].ravel():
        # Max's mean: a facet's e × f over the squares of both sides, in turn from the vertex.
        at = vertices[[np.roll(face, -list(face).index(i)) for face in faces if i in face]]
        e, f = at[:, 1] - at[:, 0], at[:, 2] - at[:, 0]
        mean = unit((np.cross(e, f) / ((e**2).sum(axis=1) * (f**2).sum(axis=1))[:, None]).sum(axis=0))
        off = vertices[sorted(set().union(*(beside[k] for k in beside[i])) - {i})] - vertices[i]
        across = np.linalg.svd(mean[None])[2][1:]
        p, q = across @ off.T
        rows = np.stack([p, q, p**2, p * q, q**2], axis=1) / np.linalg.norm(off, axis=1)[:, None]
        slope = np.linalg.lstsq(rows, off @ mean / np.linalg.norm(off, axis=1), rcond=None)[0][:2]
        assert np.abs(corners[faces == i] - unit(mean - slope @ across)).max() < 1e-12
