"""Drawings of one mirror and of twelve fit their figures: nothing is cut off, and nothing stands between wide gaps."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from mirror_cad.design_stages import design
from mirror_studio.drive import drawings
from mirror_studio.drive.measured import TurnedFigures
from raytrace.reflector import Reflector
from tests.conftest import constant, spec_of

LONG_NAME = "a-mirror-whose-file-has-a-rather-long-name-as-files-have"


@pytest.fixture(scope="module")
def reflectors() -> list[Reflector]:
    """A truck's and an interior mirror."""
    sizes = ((230.0, 320.0), (240.0, 60.0))
    return [Reflector.from_mirror(design(spec_of(constant(1250.0), constant(1250.0), outline={
        "width_mm": width, "left_height_mm": height, "right_height_mm": height, "corner_radius_mm": 20.0})))
        for width, height in sizes]


def measured(reflector: Reflector, name: str) -> Any:
    return SimpleNamespace(mirror=SimpleNamespace(reflector=reflector, name=name), orientation=SimpleNamespace(twice=True))


def drawn(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    figures: list[Figure] = []
    monkeypatch.setattr(drawings, "save", lambda figure, path: figures.append(figure))
    return figures


def fits(figure: Figure) -> None:
    """Everything that is drawn lies inside the figure."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    box = figure.get_tightbbox(canvas.get_renderer())
    width, height = figure.get_size_inches()
    assert box.x0 >= -0.01
    assert box.y0 >= -0.01
    assert box.x1 <= width + 0.01
    assert box.y1 <= height + 0.01


@pytest.mark.parametrize("which", [0, 1])
@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 12])
def test_lines_of_some_mirrors_fill_their_figure(reflectors: list[Reflector], monkeypatch: pytest.MonkeyPatch, count: int,
                                                 which: int) -> None:
    def lines(axes: Any, each: Any) -> None:
        for label in ("horizon", "lane line", "its chord", "column"):
            axes.plot([0.0, 1.0], [0.0, 1.0], label=label)

    monkeypatch.setattr(drawings, "_lines", lines)
    figures = drawn(monkeypatch)
    mirrors = [measured(reflectors[which], LONG_NAME if k % 5 == 0 else f"mirror {k}") for k in range(count)]
    for mirror in mirrors:
        mirror.orientation.twice = False
    share = drawings.line_drawings(Path("lines.png"), mirrors)
    (figure,) = figures
    fits(figure)
    assert share == pytest.approx(figure.get_size_inches()[0] / drawings.PAGE_WIDTH)
    assert 0.3 <= share <= 1.0
    panels = [axes.get_position() for axes in figure.axes[:count]]
    # The axes themselves are most of the width; what is left is labels.
    assert sum(panel.width for panel in panels[:4]) > 0.68
    assert len({round(panel.width, 2) for panel in panels}) == 1


@pytest.mark.parametrize("count", [1, 12])
@pytest.mark.parametrize("name", ["m", LONG_NAME])
def test_names_of_turned_mirrors_are_not_cut_off(reflectors: list[Reflector], monkeypatch: pytest.MonkeyPatch, count: int,
                                                 name: str) -> None:
    yaw = np.arange(-10.0, 10.5)
    turned = TurnedFigures(yaw, yaw, yaw + 40.0, yaw, np.zeros(len(yaw), dtype=np.bool_))
    monkeypatch.setattr(drawings, "turned_figures", lambda each: turned)
    figures = drawn(monkeypatch)
    drawings.turned_drawing(Path("turned.png"), [measured(reflectors[0], f"{name}-{k}") for k in range(count)])
    fits(figures[0])
    assert all(axes.get_position().height > 0.3 for axes in figures[0].axes)
