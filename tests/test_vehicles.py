"""The shipped vehicles and roadside objects: true sizes, normals, light, number plates; and the script that makes them."""

from __future__ import annotations

import io
import json
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from raytrace.scene.bodies import read_body

HOME = Path(__file__).resolve().parent.parent
ASSETS = HOME / "raytrace" / "scene" / "assets"
SCRIPT = HOME / "scripts" / "make_vehicles.py"

# Length, width without door mirrors, height [m], as scripts/vehicles states them.
VEHICLES = {"saloon": (4.650, 1.820, 1.435), "suv": (4.560, 1.880, 1.670), "van": (5.300, 1.990, 2.230),
            "truck": (8.600, 2.500, 3.700), "light-truck-flank": (4.100, 1.740, 2.450)}
PASSENGER_CARS = ("saloon", "suv")
ROADSIDE = {"column": (0.870, 0.870, 6.000), "guard-rail": (4.000, 0.200, 0.750), "noise-wall": (4.000, 0.240, 3.560)}
NAMES = (*VEHICLES, *ROADSIDE, "lamp-post", "tree-1", "tree-2")
SIZE = 0.005  # m
MIRRORS_FROM = 0.75  # m: no mirror is lower, and no car's body is widest above
FRAME = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # glTF -> x rearward, y right, z up


class Model(NamedTuple):
    """Vertices (n, 3) m, normals, faces, sky's share, name of each face's material, and the extras of the mesh."""

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    faces: NDArray[np.int64]
    sky: NDArray[np.float64]
    material: NDArray[np.str_]
    ground: dict[str, Any]

    def of(self, name: str) -> NDArray[np.int64]:
        """The vertices of a material."""
        return np.unique(self.faces[self.material == name])


def read(path: Path) -> Model:
    scene = trimesh.load_scene(path, process=False)
    parts = list(scene.geometry.values())
    offsets = np.cumsum([0, *(len(part.vertices) for part in parts)])
    return Model(np.concatenate([part.vertices for part in parts]) @ FRAME.T,
                 np.concatenate([part.vertex_normals for part in parts]) @ FRAME.T,
                 np.concatenate([part.faces + offset for part, offset in zip(parts, offsets, strict=False)]),
                 np.concatenate([part.vertex_attributes["_SKY"].ravel() for part in parts]).astype(np.float64),
                 np.concatenate([np.full(len(part.faces), part.visual.material.name) for part in parts]),
                 parts[0].metadata["ground"])


def document(path: Path) -> tuple[dict[str, Any], bytes]:
    """A GLB file's JSON and its binary chunk."""
    data = path.read_bytes()
    length, = struct.unpack("<I", data[12:16])
    return json.loads(data[20:20 + length]), data[28 + length:]


@pytest.fixture(scope="module", params=NAMES)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def model(name: str) -> Model:
    return read(ASSETS / f"{name}.glb")


def test_true_size_on_the_ground_and_on_the_median_plane(name: str, model: Model) -> None:
    low, high = model.points.min(axis=0), model.points.max(axis=0)
    assert abs(low[2]) <= 0.001
    if name in VEHICLES:
        length, width, height = VEHICLES[name]
        assert low[0] == pytest.approx(0.0, abs=SIZE)
        assert high[0] == pytest.approx(length, abs=SIZE)
        assert high[2] == pytest.approx(height, abs=SIZE)
        body = model.points if name in ("truck", "light-truck-flank") else model.points[model.points[:, 2] < MIRRORS_FROM]
        body = body[body[:, 0] > 2.2] if name == "truck" else body  # its mirrors stand out from the cab
        assert np.ptp(body[:, 1]) == pytest.approx(width, abs=SIZE)
        assert body[:, 1].max() == pytest.approx(-body[:, 1].min(), abs=1e-4)
    if name in ROADSIDE:
        assert high - low == pytest.approx(ROADSIDE[name], abs=SIZE)
    if name in PASSENGER_CARS:
        assert 1.75 <= VEHICLES[name][1] <= 1.95


def test_normals_are_unit_and_on_the_side_that_triangles_face(model: Model) -> None:
    assert np.linalg.norm(model.normals, axis=1) == pytest.approx(1.0, abs=1e-5)
    corners = model.points[model.faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    with_normals = (area * model.normals[model.faces].sum(axis=1)).sum(axis=1)
    assert (with_normals >= -1e-12).all()


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_paint_faces_outward(vehicle: str) -> None:
    """A body whose faces look inward is dark on all sides: nearly all that is painted looks away from the middle."""
    model = read(ASSETS / f"{vehicle}.glb")
    triangles = model.faces[model.material == "paint"]
    corners = model.points[triangles]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    middle = corners.mean(axis=1)
    towards = middle - (np.clip(middle[:, 0], 1.0, middle[:, 0].max() - 1.0)[:, None] * (1.0, 0.0, 0.0) + (0.0, 0.0, 0.7))
    size = np.linalg.norm(area, axis=1)
    assert size[(area * towards).sum(axis=1) > 0.0].sum() >= 0.95 * size.sum()


def test_column_holds_the_volume_of_its_two_turned_bodies() -> None:
    """Closed and outward: the shaft is a frustum with a chamfer, the base a ring with one, both within a facet's sagitta."""
    scene = trimesh.load_scene(ASSETS / "column.glb", process=False)
    mesh = trimesh.Trimesh(*(getattr(scene.to_mesh(), part) for part in ("vertices", "faces")), process=True)

    def frustum(r: float, s: float, h: float) -> float:
        return np.pi * h * (r * r + r * s + s * s) / 3.0

    expected = (frustum(0.300, 0.285, 5.765) + frustum(0.285, 0.260, 0.025)
                + frustum(0.435, 0.435, 0.180) + frustum(0.435, 0.414, 0.030) - frustum(0.280, 0.280, 0.210))
    assert mesh.volume == pytest.approx(expected, rel=0.02)


def test_sky_shares(name: str, model: Model) -> None:
    assert (model.sky >= 0.0).all()
    assert (model.sky <= 1.0).all()
    if name in ("saloon", "suv", "van"):
        painted = model.of("paint")
        roof = painted[(model.points[painted, 2] > 0.985 * VEHICLES[name][2]) & (model.normals[painted, 2] > 0.95)]
        assert len(roof) > 50
        assert np.median(model.sky[roof]) >= 0.99
        assert model.sky[roof].min() >= 0.9
        # Deep in the wheel houses, under their tops: the tyre below, the house around.
        dark = model.of("trim")
        x, y, z = model.points[dark].T
        deep = np.abs(y) < 0.5 * VEHICLES[name][1] - 0.15
        houses = dark[(model.normals[dark, 2] < -0.9) & (z > 0.6) & (z < 0.85) & (x < VEHICLES[name][0]) & deep]
        assert len(houses) > 8
        assert np.median(model.sky[houses]) < 0.35


def test_ground_below_is_dark_and_the_border_bright(name: str, model: Model) -> None:
    ground = model.ground
    sky = np.array(ground["sky"]).reshape(ground["nx"], ground["ny"])
    assert ((sky >= 0.0) & (sky <= 1.0)).all()
    for edge in (sky[0], sky[-1], sky[:, 0], sky[:, -1]):
        assert edge.min() >= 0.97
    low, high = model.points.min(axis=0), model.points.max(axis=0)
    for k, axis in enumerate("xy"):
        start, step, count = ground[f"{axis}0"], ground[f"d{axis}"], ground[f"n{axis}"]
        assert 0.1 <= step <= 0.15
        assert start <= low[k] - 1.1
        assert start + step * (count - 1) >= high[k] + 1.1
    if name in VEHICLES:
        middle = 0.5 * VEHICLES[name][0]
        assert sky[round((middle - ground["x0"]) / ground["dx"]), round(-ground["y0"] / ground["dy"])] < 0.3


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_plates_read_from_left_to_right(vehicle: str) -> None:
    tree, binary = document(ASSETS / f"{vehicle}.glb")
    view = tree["bufferViews"][tree["images"][0]["bufferView"]]
    data = binary[view["byteOffset"]:view["byteOffset"] + view["byteLength"]]
    plate = np.asarray(Image.open(io.BytesIO(data)).convert("L"), dtype=np.float64)[8:-8, 8:-8]
    drawn = Image.new("L", (plate.shape[1], plate.shape[0]), 236)
    middle = 0.5 * plate.shape[1], 0.5 * plate.shape[0]
    ImageDraw.Draw(drawn).text(middle, "MC 2014", 18, font=ImageFont.load_default(size=86), anchor="mm", stroke_width=2)
    written = np.asarray(drawn, dtype=np.float64)

    def likeness(text: NDArray[np.float64]) -> float:
        """The greatest correlation within a shift of 6 dots."""
        shifts = [(dy, dx) for dy in range(-6, 7) for dx in range(-6, 7)]
        return max(float(np.corrcoef(np.roll(text, shift, axis=(0, 1)).ravel(), plate.ravel())[0, 1]) for shift in shifts)

    assert likeness(written) > 0.9
    assert likeness(written[:, ::-1]) < 0.6
    scene = trimesh.load_scene(ASSETS / f"{vehicle}.glb", process=False)
    part = next(part for part in scene.geometry.values() if part.visual.material.name == "plate")
    for triangle in part.faces:
        points, uv = part.vertices[triangle], part.visual.uv[triangle] * (1.0, -1.0)  # trimesh turns v up; here it is down
        to_right = np.cross((0.0, 1.0, 0.0), part.vertex_normals[triangle[0]])
        flat = points @ np.column_stack([to_right, (0.0, 1.0, 0.0)])
        along = np.linalg.solve(flat[1:] - flat[0], uv[1:] - uv[0])
        assert along[0, 0] > 1.0  # u grows to the reader's right
        assert along[1, 1] < -1.0  # and v downwards


def test_small_enough_to_ship(name: str, model: Model) -> None:
    assert (ASSETS / f"{name}.glb").stat().st_size <= 720_000
    if name in VEHICLES:
        assert 8_000 <= len(model.faces) <= 26_000
    assert not {"uri"} & {key for buffer in document(ASSETS / f"{name}.glb")[0]["buffers"] for key in buffer}


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_a_scene_places_and_paints_them(vehicle: str) -> None:
    body = read_body(ASSETS / f"{vehicle}.glb").painted((0.1, 0.2, 0.3)).placed((5000.0, -3500.0, 0.0))
    assert body.vertices[:, 0].min() == pytest.approx(5000.0, abs=1e3 * SIZE)
    assert body.contact is not None
    assert {material.name for material in body.materials} >= {"paint", "glass", "tyre", "rim", "trim", "tail-lamp", "plate"}


@pytest.mark.long
def test_the_script_makes_the_same_files_again(tmp_path: Path) -> None:
    """Bytes between runs on one machine; figures against what is shipped, which another processor may have rounded."""
    names = ("column", "guard-rail", "tree-1")
    for folder in ("first", "second"):
        (tmp_path / folder).mkdir()
        subprocess.run([sys.executable, str(SCRIPT), "--out", str(tmp_path / folder), *names], check=True, capture_output=True,
                       cwd=HOME)
    for again in names:
        made = tmp_path / "first" / f"{again}.glb"
        assert made.read_bytes() == (tmp_path / "second" / f"{again}.glb").read_bytes()
        new, shipped = read(made), read(ASSETS / f"{again}.glb")
        assert new.points == pytest.approx(shipped.points, abs=1e-5)
        assert (new.faces == shipped.faces).all()
        assert new.sky == pytest.approx(shipped.sky, abs=0.05)


def test_the_script_names_the_models_it_knows(tmp_path: Path) -> None:
    run = subprocess.run([sys.executable, str(SCRIPT), "--out", str(tmp_path), "tractor"], capture_output=True, text=True,
                         cwd=HOME)
    assert run.returncode == 2
    assert "tractor" in run.stderr
    assert "saloon" in run.stderr
    assert not list(tmp_path.iterdir())
