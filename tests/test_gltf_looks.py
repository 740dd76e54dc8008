"""How glTF says that things look: cut-outs, blending, colours of vertices, moved pictures; drawn, or said to be left out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from mirror_cad.errors import FileError
from raytrace import load_reflector
from raytrace.scene.bodies import Body, body_of, read_body
from raytrace.scene.daylight import Daylight
from raytrace.scene.lit_world import LitWorld
from raytrace.scene.materials import Material
from raytrace.surfaces.mesh import MeshSurface
from tests.test_bodies import Glb, png

PLATE = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 2.0, 0.0], [0.0, 2.0, 0.0]])  # m, y up, seen from +z
PLATE_FACES = np.array([[0, 1, 2], [0, 2, 3]])
UV = np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]])
MATT: dict[str, Any] = {"metallicFactor": 0.0, "roughnessFactor": 1.0}
DAY = Daylight.clear(20.0, 40.0)


def leaf_picture(n: int = 16) -> np.ndarray:
    """A green disc that covers, nothing beside it."""
    y, x = np.mgrid[:n, :n] + 0.5
    picture = np.zeros((n, n, 4), dtype=np.uint8)
    picture[..., :3] = [40, 160, 60]
    picture[..., 3] = np.where(np.hypot(x - n / 2, y - n / 2) < 0.3 * n, 255, 0)
    return picture


def plate(path: Path, material: dict[str, Any], picture: np.ndarray | None = None, **attributes: np.ndarray) -> Path:
    file = Glb()
    if picture is not None:
        material = material | {"pbrMetallicRoughness": material.get("pbrMetallicRoughness", MATT)
                               | {"baseColorTexture": {"index": file.texture(png(picture))}}}
    return file.mesh(PLATE, PLATE_FACES, material, **({"TEXCOORD_0": UV} | attributes)).write(path)


def backdrop(colour: tuple[float, float, float] = (0.5, 0.5, 0.5)) -> Body:
    """A large wall 3 m behind the plate: in the world the plate stands at X = 0 and faces −X."""
    return body_of(np.array([[3000.0, -9e3, -9e3], [3000.0, 9e3, -9e3], [3000.0, 9e3, 9e3], [3000.0, -9e3, 9e3]]),
                   np.array([[0, 2, 1], [0, 3, 2]]), Material("wall", colour), sky=np.ones(4))


def seen(bodies: tuple[Body, ...], at: np.ndarray) -> np.ndarray:
    """Radiance along +X through places (n, 2) of the plate, in m: to the right as seen, and up."""
    origins = np.column_stack([np.full(len(at), -4000.0), -1000.0 * at[:, 0], 1000.0 * at[:, 1]])
    return LitWorld(bodies, None, DAY).radiance(origins, np.tile([1.0, 0.0, 0.0], (len(at), 1)), 1e-5)


def grid(n: int) -> np.ndarray:
    """Places over the plate, off its edges and off the middle line that its triangles share."""
    x, y = np.meshgrid((np.arange(n) + 0.5137) / n * 2.0, (np.arange(n) + 0.4731) / n * 2.0)
    return np.column_stack([x.ravel(), y.ravel()])


def alpha_at(picture: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Cover by hand: linear between the middles of elements, repeated."""
    n = picture.shape[0]
    row, column = (1.0 - at[:, 1] / 2.0) * n - 0.5, at[:, 0] / 2.0 * n - 0.5
    i, j = np.floor(row).astype(int), np.floor(column).astype(int)
    a, b = row - i, column - j
    alpha = picture[..., 3] / 255.0
    return ((1 - a) * ((1 - b) * alpha[i % n, j % n] + b * alpha[i % n, (j + 1) % n])
            + a * ((1 - b) * alpha[(i + 1) % n, j % n] + b * alpha[(i + 1) % n, (j + 1) % n]))


@pytest.mark.parametrize("cutoff", [None, 0.2, 0.8])
def test_rays_pass_where_a_leaf_card_covers_less_than_its_cutoff(tmp_path: Path, cutoff: float | None) -> None:
    """The case leaf-card-mask: every ray of a grid shows the wall behind or the leaf, as its picture says by hand."""
    picture = leaf_picture()
    material = {"alphaMode": "MASK"} | ({} if cutoff is None else {"alphaCutoff": cutoff})
    card = read_body(plate(tmp_path / "leaf.glb", material, picture))
    assert card.left_out == ""
    at = grid(40)
    through = alpha_at(picture, at) < (0.5 if cutoff is None else cutoff)
    wall = backdrop()
    found, alone = seen((card, wall), at), seen((wall,), at)
    assert 0.5 < through.mean() < 0.9
    assert found[through] == pytest.approx(alone[through], rel=0.3)  # the leaf's shadow may lie on it
    assert np.array_equal(found[:, 1] > 1.5 * found[:, 0], ~through)  # the leaf is green, the wall is gray


def test_a_leaf_card_s_shadow_has_the_leaf_s_shape(tmp_path: Path) -> None:
    """Every place of the wall is seen sunlit or not as the card's picture says by hand, where the sun's ray passes it."""
    picture = leaf_picture()
    card = read_body(plate(tmp_path / "leaf.glb", {"alphaMode": "MASK"}, picture))
    day = Daylight.clear(0.0, 5.0)
    assert day.sun[0] < -0.9  # ahead of the plate, which is ahead of the wall
    at = grid(30)
    places = np.column_stack([np.zeros(len(at)), -1000.0 * at[:, 0], 1000.0 * at[:, 1]]) + 3000.0 * day.sun / day.sun[0]
    found = LitWorld((card, backdrop()), None, day).radiance(places - [500.0, 0.0, 0.0], np.tile([1.0, 0.0, 0.0], (len(at), 1)),
                                                             1e-5)[:, 1]
    hidden = alpha_at(picture, at) >= 0.5
    assert found[hidden].max() < 0.5 * found[~hidden].min()


@pytest.mark.parametrize("share", [0.0, 0.25, 0.6, 1.0])
def test_a_blended_plate_shows_its_share_of_itself_and_the_rest_of_what_is_behind(tmp_path: Path, share: float) -> None:
    """out = α·plate + (1 − α)·wall, the plate alone and the wall alone traced by themselves."""
    blended = {"alphaMode": "BLEND", "pbrMetallicRoughness": MATT | {"baseColorFactor": [0.8, 0.1, 0.1, share]}}
    whole = {"pbrMetallicRoughness": MATT | {"baseColorFactor": [0.8, 0.1, 0.1, 1.0]}}
    body, solid, wall = read_body(plate(tmp_path / "a.glb", blended)), read_body(plate(tmp_path / "b.glb", whole)), backdrop()
    at = grid(5)
    expected = share * seen((solid, wall), at) + (1.0 - share) * seen((wall,), at)
    assert seen((body, wall), at) == pytest.approx(expected, rel=2e-3)


def test_many_blended_layers_are_all_seen_through(tmp_path: Path) -> None:
    """Five panes of 30 %: the wall keeps 0.7⁵ of its light, the sky behind it none."""
    body = read_body(plate(tmp_path / "pane.glb", {}))
    black = Material("", (0.0, 0.0, 0.0), specular=(0.0, 0.0, 0.0), opacity=0.3)
    panes = tuple(body_of(body.vertices + [400.0 * k, 0.0, 0.0], body.faces, black, sky=np.ones(len(body.vertices)))
                  for k in range(5))
    wall = backdrop()
    at = grid(4)
    # The wall as it is lit behind them, each pane letting all of the sun through: under half, it casts no shadow.
    assert seen((*panes, wall), at) == pytest.approx(0.7**5 * seen((wall,), at), rel=1e-2)


def test_colours_of_vertices_multiply_the_material_s(tmp_path: Path) -> None:
    """COLOR_0 is linear; between vertices it is linear too. As bytes, as floats, with cover; against a plain plate's light."""
    corners = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.25, 0.5, 0.75]])
    white = read_body(plate(tmp_path / "white.glb", {"pbrMetallicRoughness": MATT | {"baseColorFactor": [0.8, 0.8, 0.8, 1.0]}}))
    at = grid(12)
    plain = seen((white,), at)
    for colours in (corners, np.column_stack([corners, np.full(4, 0.3)])):
        file = Glb()
        file.mesh(PLATE, PLATE_FACES, {"pbrMetallicRoughness": MATT | {"baseColorFactor": [0.8, 0.8, 0.8, 1.0]}}, TEXCOORD_0=UV)
        attribute = file.accessor(colours.astype(np.float32), f"VEC{colours.shape[1]}")
        file.tree["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = attribute
        body = read_body(file.write(tmp_path / "colours.glb"))
        assert body.left_out == ""
        found = seen((body,), at)
        x, y = at.T / 2.0
        below = y[:, None] <= x[:, None]  # the first triangle: corners 0, 1, 2; the second: 0, 2, 3
        share = np.where(below, (1 - x)[:, None] * corners[0] + (x - y)[:, None] * corners[1] + y[:, None] * corners[2],
                         (1 - y)[:, None] * corners[0] + x[:, None] * corners[2] + (y - x)[:, None] * corners[3])
        black = seen((read_body(plate(tmp_path / "black.glb", {
            "pbrMetallicRoughness": MATT | {"baseColorFactor": [0.0, 0.0, 0.0, 1.0]}})),), at)
        assert found - black == pytest.approx(share * (plain - black), rel=1e-5, abs=1e-7)


def test_bytes_of_colours_are_shares_of_255_and_tint_metals(tmp_path: Path) -> None:
    file = Glb().mesh(PLATE, PLATE_FACES, {"pbrMetallicRoughness": {"roughnessFactor": 0.2}})
    view = file.view(np.tile(np.array([255, 51, 0, 255], dtype=np.uint8), (4, 1)).tobytes())
    file.tree["accessors"].append({"bufferView": view, "componentType": 5121, "normalized": True, "count": 4, "type": "VEC4"})
    file.tree["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = len(file.tree["accessors"]) - 1
    body = read_body(file.write(tmp_path / "metal.glb"))
    assert body.colours == pytest.approx(np.tile([1.0, 0.2, 0.0, 1.0], (len(body.vertices), 1)))
    assert body.materials[0].specular == pytest.approx((1.0, 0.2, 0.0))


def test_specular_glossiness_is_drawn_by_its_diffuse_colour_and_specular(tmp_path: Path) -> None:
    """The case red-specular-glossiness, with pictures and without, used and required."""
    glossy = {"diffuseFactor": [0.8, 0.1, 0.1, 1.0], "specularFactor": [0.04, 0.05, 0.06], "glossinessFactor": 0.3}
    for required in (False, True):
        file = Glb()
        picture = file.texture(png(np.full((2, 2, 3), 128, dtype=np.uint8)))
        gloss = file.texture(png(np.full((2, 2, 4), [255, 255, 255, 102], dtype=np.uint8)))
        file.mesh(PLATE, PLATE_FACES, {"extensions": {"KHR_materials_pbrSpecularGlossiness": glossy}}, TEXCOORD_0=UV)
        file.mesh(PLATE, PLATE_FACES, {"extensions": {"KHR_materials_pbrSpecularGlossiness": glossy | {
            "diffuseTexture": {"index": picture}, "specularGlossinessTexture": {"index": gloss}}}}, TEXCOORD_0=UV)
        file.tree["nodes"] = [{"mesh": 0, "children": [1]}, {"mesh": 1}]
        file.tree["extensionsUsed"] = ["KHR_materials_pbrSpecularGlossiness"]
        file.tree["extensionsRequired"] = ["KHR_materials_pbrSpecularGlossiness"] if required else []
        body = read_body(file.write(tmp_path / "red.glb"))
        plain, pictured = body.materials
        assert plain.diffuse == (0.8, 0.1, 0.1)
        assert plain.specular == (0.04, 0.05, 0.06)
        assert plain.roughness == pytest.approx(0.7)
        assert pictured.texture is not None
        assert (pictured.texture == 128).all()
        assert pictured.roughness == pytest.approx(1.0 - 0.3 * 102.0 / 255.0)
        assert body.left_out == ""


def test_a_texture_is_turned_scaled_moved_and_laid_on_the_set_of_coordinates_that_it_names(tmp_path: Path) -> None:
    """KHR_texture_transform's own example: uv′ = T·R·S·uv, the turn counter-clockwise about the picture's upper left."""
    turn = 0.3
    change = {"offset": [0.1, 0.2], "rotation": turn, "scale": [2.0, 3.0], "texCoord": 1}
    second = np.random.default_rng(2).uniform(0.0, 1.0, (4, 2))
    for required, texture in ((False, {"texCoord": 0, "extensions": {"KHR_texture_transform": change}}),
                              (True, {"texCoord": 1, "extensions": {"KHR_texture_transform": {
                                  key: value for key, value in change.items() if key != "texCoord"}}})):
        file = Glb()
        index = {"index": file.texture(png(np.full((2, 2, 3), 128, dtype=np.uint8)))}
        file.mesh(PLATE, PLATE_FACES, {"pbrMetallicRoughness": MATT | {"baseColorTexture": index | texture}}, TEXCOORD_0=UV,
                  TEXCOORD_1=second, NORMAL=np.tile([0.0, 0.0, 1.0], (4, 1)))
        file.tree["extensionsUsed"] = ["KHR_texture_transform"]
        file.tree["extensionsRequired"] = ["KHR_texture_transform"] if required else []
        body = read_body(file.write(tmp_path / "moved.glb"))
        scale, offset = np.diag([2.0, 3.0, 1.0]), np.array([[1.0, 0.0, 0.1], [0.0, 1.0, 0.2], [0.0, 0.0, 1.0]])
        # The specification's matrix, written row by row: [[cos, sin], [−sin, cos]].
        rotation = np.array([[np.cos(turn), np.sin(turn), 0.0], [-np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
        expected = (offset @ rotation @ scale @ np.column_stack([second, np.ones(4)]).T).T[:, :2]
        assert body.uv == pytest.approx(expected, abs=1e-6)
        assert body.left_out == ""


def test_what_is_not_drawn_is_named_in_one_line_and_what_is_required_and_unknown_refused(tmp_path: Path) -> None:
    file = Glb()
    texture = {"index": file.texture(png(np.full((2, 2, 3), 128, dtype=np.uint8)))}
    file.mesh(PLATE, PLATE_FACES, {"pbrMetallicRoughness": MATT, "normalTexture": texture, "emissiveFactor": [1, 0, 0],
                                   "extensions": {"KHR_materials_transmission": {"transmissionFactor": 1.0}, "ACME_paint": {}}})
    file.tree["extensionsUsed"] = ["KHR_materials_transmission", "ACME_paint", "KHR_lights_punctual"]
    body = read_body(file.write(tmp_path / "car.glb"))
    assert body.left_out == "car.glb: left out: emission, extension ACME_paint, lights, normal maps, transmission"
    file.tree["extensionsRequired"] = ["ACME_paint"]
    with pytest.raises(FileError, match="needs the glTF extension ACME_paint, which is not read"):
        read_body(file.write(tmp_path / "car.glb"))


def test_webp_textures_are_read_and_a_bare_mesh_needs_no_looks(tmp_path: Path) -> None:
    file = Glb()
    file.mesh(PLATE, PLATE_FACES, {"pbrMetallicRoughness": MATT | {"baseColorTexture": {"index": 0}}}, TEXCOORD_0=UV)
    stream = tmp_path / "a.webp"
    Image.new("RGB", (4, 4), (200, 10, 10)).save(stream, lossless=True)
    file.tree["images"], file.tree["textures"] = [{"uri": "a.webp"}], [{"extensions": {"EXT_texture_webp": {"source": 0}}}]
    file.tree["extensionsRequired"] = ["EXT_texture_webp"]
    body = read_body(file.write(tmp_path / "a.glb"))
    assert body.materials[0].texture is not None
    assert (body.materials[0].texture == (200, 10, 10)).all()
    file.tree["extensionsRequired"] = ["KHR_materials_unheard_of", "KHR_texture_basisu"]
    stream.unlink()
    assert isinstance(load_reflector(file.write(tmp_path / "a.glb")).surface, MeshSurface)


@pytest.mark.parametrize(("generator", "units", "size_mm"), [
    (None, "mm", 2000.0), (None, "inch", 2000.0), ("Blender", "furlong", 2000.0), (None, None, 2000.0),
    ("https://github.com/mikedh/trimesh", None, 2000.0), ("https://github.com/mikedh/trimesh", "m", 2000.0),
    ("https://github.com/mikedh/trimesh", "mm", 2.0), ("https://github.com/mikedh/trimesh", "inch", 50.8)])
def test_gltf_is_in_metres_whatever_extras_say_but_for_trimesh_s_own(tmp_path: Path, generator: str | None, units: str | None,
                                                                    size_mm: float) -> None:
    """The case gltf-units-extras. trimesh writes its numbers as they are and names their unit: there, and only there."""
    file = Glb().mesh(PLATE, PLATE_FACES, extras=None if units is None else {"units": units})
    if generator is not None:
        file.tree["asset"]["generator"] = generator
    surface = load_reflector(file.write(tmp_path / "plate.glb")).surface
    assert isinstance(surface, MeshSurface)
    assert np.ptp(surface.mesh.vertices, axis=0).max() == pytest.approx(size_mm)
    file.tree["nodes"] = [{"mesh": 0, "scale": [100.0, 100.0, 100.0]}]
    body = read_body(file.write(tmp_path / "plate.glb"))
    assert np.ptp(body.vertices, axis=0).max() == pytest.approx(100.0 * size_mm)


def test_a_file_of_trimesh_itself_keeps_its_size(tmp_path: Path) -> None:
    """Written by the library: 230 mm are 230 mm."""
    import trimesh

    box = trimesh.creation.box((230.0, 150.0, 10.0))
    for units, size in (("mm", 230.0), (None, 230000.0)):
        box.units = units
        box.export(tmp_path / "box.glb")
        surface = load_reflector(tmp_path / "box.glb").surface
        assert isinstance(surface, MeshSurface)
        assert np.ptp(surface.mesh.vertices, axis=0).max() == pytest.approx(size)
    box.units = "parsec"
    box.export(tmp_path / "box.glb")
    with pytest.raises(FileError, match="its unit 'parsec' is none of micron"):
        load_reflector(tmp_path / "box.glb")
