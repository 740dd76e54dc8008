"""Drawings of one mirror and of twelve fit their figures: nothing is cut off, and nothing stands between wide gaps."""

from __future__ import annotations

import base64
import io
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image, ImageFont

from mirror_cad.design_stages import design
from mirror_studio.drive import lines, turned
from mirror_studio.drive.drawings import outline_of, thinned
from mirror_studio.drive.maps import _contains, magnification_maps
from mirror_studio.drive.measured import TurnedFigures
from mirror_studio.report.drawing import WIDTH
from mirror_studio.report.map_panel import MapPanel
from mirror_studio.report.typeface import typeface
from raytrace.reflector import Reflector
from tests.conftest import constant, spec_of

LONG_NAME = "a-mirror-whose-file-has-a-rather-long-name-as-files-have"
SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def reflectors() -> list[Reflector]:
    """A truck's and an interior mirror."""
    sizes = ((230.0, 320.0), (240.0, 60.0))
    return [Reflector.from_mirror(design(spec_of(constant(1250.0), constant(1250.0), outline={
        "width_mm": width, "left_height_mm": height, "right_height_mm": height, "corner_radius_mm": 20.0})))
        for width, height in sizes]


def measured(reflector: Reflector, name: str) -> Any:
    return SimpleNamespace(mirror=SimpleNamespace(reflector=reflector, name=name), orientation=SimpleNamespace(twice=True))


def texts(root: ElementTree.Element) -> list[tuple[ElementTree.Element, np.ndarray]]:
    """Texts that nothing cuts, each with (x_from, x_to, y_from, y_to) in a typeface wider than a browser's."""
    found = []
    for each in root.findall(f"{SVG}text"):
        size, x, y = (float(each.get(key, "nan")) for key in ("font-size", "x", "y"))
        font = typeface("DejaVuSans.ttf", 100)
        assert isinstance(font, ImageFont.FreeTypeFont)
        long = 0.01 * size * font.getlength(each.text or "")
        start = {"start": 0.0, "middle": -0.5 * long, "end": -long}[each.get("text-anchor", "start")]
        box = [x + start, x + start + long, y - 0.8 * size, y + 0.25 * size]
        if "rotate" in each.get("transform", ""):
            box = [x - 0.8 * size, x + 0.25 * size, y - start - long, y - start]
        found.append((each, np.array(box)))
    return found


def fits(path: Path) -> ElementTree.Element:
    """Every text lies inside the drawing, and none on another."""
    root = ElementTree.fromstring(path.read_text("utf-8"))
    _, _, width, height = (float(part) for part in root.get("viewBox", "").split())
    boxes = texts(root)
    for each, (left, right, top, bottom) in boxes:
        assert left >= -0.5, each.text
        assert right <= width + 0.5, each.text
        assert top >= 0.0, each.text
        assert bottom <= height, each.text
    for k, (each, a) in enumerate(boxes):
        for other, b in boxes[:k]:
            apart = a[0] >= b[1] - 3.0 or b[0] >= a[1] - 3.0 or a[2] >= b[3] - 3.0 or b[2] >= a[3] - 3.0
            assert apart, (each.text, other.text)
    return root


def rims(root: ElementTree.Element) -> list[np.ndarray]:
    """The mirrors' outlines, px, each with its least and largest x and y."""
    paths = [each.get("d", "") for clip in root.findall(f"{SVG}clipPath") for each in clip]
    points = [np.array(re.findall(r"-?[\d.]+", path), dtype=np.float64).reshape(-1, 2) for path in paths]
    return [np.stack([each.min(axis=0), each.max(axis=0)]) for each in points]


@pytest.mark.parametrize("which", [0, 1])
@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 12])
def test_lines_of_some_mirrors_fill_their_figure(reflectors: list[Reflector], monkeypatch: pytest.MonkeyPatch, tmp_path: Path,
                                                 count: int, which: int) -> None:
    monkeypatch.setattr(lines, "_lines", lambda panel, each: set(lines.LINES))
    mirrors = [measured(reflectors[which], LONG_NAME if k % 5 == 0 else f"mirror {k}") for k in range(count)]
    for mirror in mirrors:
        mirror.orientation.twice = False
    share = lines.line_drawings(tmp_path / "lines.svg", mirrors)
    root = fits(tmp_path / "lines.svg")
    assert float(root.get("width", "nan")) == pytest.approx(share * WIDTH)
    assert 0.3 <= share <= 1.0
    sizes = [np.ptp(rim, axis=0) for rim in rims(root)]
    assert len(sizes) == count
    # The mirrors themselves are most of the width; what is left is numbers.
    assert sum(size[0] for size in sizes[:lines.MAX_BESIDE]) > 0.68 * share * WIDTH
    assert len({round(size[0]) for size in sizes}) == 1
    for key in lines.LINES:
        assert key in [each.text for each in root.findall(f"{SVG}text")]


def test_a_mirror_that_shows_things_twice_has_words_for_its_lines(reflectors: list[Reflector], tmp_path: Path) -> None:
    lines.line_drawings(tmp_path / "lines.svg", [measured(reflectors[0], "m"), measured(reflectors[1], "n")])
    words = [each.text for each in fits(tmp_path / "lines.svg").findall(f"{SVG}text")]
    assert words.count("not measured") == 2
    assert not set(lines.LINES) & set(words)


@pytest.mark.parametrize("count", [1, 12])
@pytest.mark.parametrize("name", ["m", LONG_NAME])
def test_names_of_turned_mirrors_are_not_cut_off(reflectors: list[Reflector], monkeypatch: pytest.MonkeyPatch, tmp_path: Path,
                                                 count: int, name: str) -> None:
    yaw = np.arange(-10.0, 10.5)
    low, high = yaw.copy(), yaw + 40.0
    low[0], high[-1] = np.nan, np.nan  # each without the other
    found = TurnedFigures(yaw, low, high, yaw, yaw > 5.0)
    monkeypatch.setattr(turned, "turned_figures", lambda each: found)
    turned.turned_drawing(tmp_path / "turned.svg", [measured(reflectors[0], f"{name}-{k}") for k in range(count)])
    words = [each.text for each in fits(tmp_path / "turned.svg").findall(f"{SVG}text")]
    assert all(f"{name}-{k}" in words for k in range(count))


def test_turned_mirrors_that_show_nothing_have_axes(reflectors: list[Reflector], monkeypatch: pytest.MonkeyPatch,
                                                    tmp_path: Path) -> None:
    yaw = np.arange(-10.0, 10.5)
    none = np.full(len(yaw), np.nan)
    monkeypatch.setattr(turned, "turned_figures",
                        lambda each: TurnedFigures(yaw, none, none, none, np.zeros(len(yaw), dtype=np.bool_)))
    turned.turned_drawing(tmp_path / "turned.svg", [measured(reflectors[0], "m")])
    assert "nan" not in (tmp_path / "turned.svg").read_text("utf-8")


@pytest.mark.parametrize("count", [1, 3])
def test_maps_fill_the_outline_and_are_blank_where_nothing_is_known(reflectors: list[Reflector], tmp_path: Path,
                                                                    count: int) -> None:
    mirrors = []
    for k in range(count):
        mirror = measured(reflectors[k % 2], f"{LONG_NAME}-{k}")
        x_min, x_max, y_min, y_max = (*np.ptp(outline_of(reflectors[k % 2]), axis=0) * 0.5,) * 2
        x, y = -x_min + (np.arange(40) + 0.5) * x_min / 20, -x_max + (np.arange(30) + 0.5) * x_max / 15
        inside = _contains(outline_of(reflectors[k % 2]), x, y)
        field = np.where(inside, 0.5 + 1e-3 * x + 0.0 * y[:, None], np.nan)
        mirror.magnification = SimpleNamespace(x=x, y=y, magnification=SimpleNamespace(horizontal=field, vertical=field,
                                                                                       ratio=field))
        mirror.disparity = SimpleNamespace(x=x, y=y, percent=field)
        mirrors.append(mirror)
    magnification_maps(tmp_path / "maps.svg", mirrors)
    root = fits(tmp_path / "maps.svg")
    assert len(rims(root)) == 4 * count
    for k, image in enumerate(root.iter(f"{SVG}image")):
        picture = Image.open(io.BytesIO(base64.b64decode(image.get("href", "").partition(",")[2])))
        if k % 4 == 3:  # some things twice: no disparity
            assert picture.convert("RGBA").getextrema()[3] == (0, 0)
            continue
        # What the outline cuts is known, two cells beyond it too.
        rim, (x_min, x_max) = outline_of(mirrors[k // 4].mirror.reflector), (mirrors[k // 4].magnification.x[[0, -1]])
        y_min, y_max = mirrors[k // 4].magnification.y[[0, -1]]
        x, y = (np.linspace(a, b, n) for a, b, n in ((x_min, x_max, picture.width), (y_min, y_max, picture.height)))
        opaque = np.asarray(picture.convert("RGBA"))[::-1, :, 3] == 255
        assert opaque[_contains(rim, x, y)].all()


def test_a_thinned_ring_keeps_its_shape() -> None:
    """A circle's sagitta is r(1 − cos(π/n)); a square has its corners left."""
    angle = np.linspace(0.0, 2.0 * np.pi, 4000, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    few = thinned(circle, 1e-3)
    assert len(few) < 160
    middles = 0.5 * (few + np.roll(few, -1, axis=0))
    assert np.linalg.norm(middles, axis=1).min() >= 1.0 - 1.001e-3
    side = np.linspace(0.0, 1.0, 50, endpoint=False)
    square = np.concatenate([np.stack(pair, axis=1) for pair in (
        (side, 0 * side), (1 + 0 * side, side), (1 - side, 1 + 0 * side), (0 * side, 1 - side))])
    assert thinned(square, 1e-6).tolist() == [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]


def test_the_inside_of_a_ring_is_that_of_its_angles() -> None:
    """Beside the sum of the angles under which a place sees the edges: 2π inside, 0 outside."""
    rng = np.random.default_rng(5)
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, 40))
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1) * rng.uniform(0.4, 1.0, (40, 1))
    x, y = np.linspace(-1.1, 1.1, 61), np.linspace(-1.2, 1.0, 47)
    places = np.stack(np.meshgrid(x, y), axis=-1)
    to = np.arctan2(*np.moveaxis(ring - places[:, :, None], -1, 0)[::-1])
    turns = (np.diff(to, axis=2, append=to[:, :, :1]) + np.pi) % (2.0 * np.pi) - np.pi
    assert np.array_equal(_contains(ring, x, y), np.abs(turns.sum(axis=2)) > np.pi)


def test_names_on_contours_stand_on_them_and_apart() -> None:
    """Lines of x² + y² = r² have their names at r from the middle; none of two stands on the other."""
    panel = MapPanel(0.0, 0.0, 400.0, 400.0, (-200.0, 200.0, -200.0, 200.0), np.zeros((3, 2)), 0)
    x = np.linspace(-200.0, 200.0, 201)
    radii = np.arange(40.0, 200.0, 30.0)
    panel.contours(x, x, np.hypot(x[:, None], x), [float(radius) for radius in radii], 1.0, [f"{r:g}" for r in radii])
    spots = np.array([re.findall(r"translate\(([\d.]+) ([\d.]+)\)", part)[0] for part in panel.parts if "translate" in part],
                     dtype=np.float64)
    assert np.linalg.norm(spots - 200.0, axis=1) == pytest.approx(radii, abs=0.5)
    gaps = np.linalg.norm(spots[:, None] - spots, axis=2)[np.triu_indices(len(radii), 1)]
    assert gaps.min() > 25.0
