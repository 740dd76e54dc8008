"""What several tests of outlines share: outlines, the files they are drawn in, and how two of them are compared."""

import math
import re
from pathlib import Path

import ezdxf
import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from mirror_cad.errors import OutlineError
from mirror_cad.outline import Arc, Line, Outline, Spline, truck_outline

# tmp_path is shared between the examples of one test; each example overwrites its one file.
examples = settings(deadline=None, max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])


def distance_to(points: np.ndarray, outline: Outline, tolerance: float = 1e-4) -> float:
    """Largest distance in mm from the points (n, 2) to the outline's polygon."""
    start = outline.polyline(tolerance)
    direction = np.roll(start, -1, axis=0) - start
    offset = points[:, None] - start
    along = np.clip((offset * direction).sum(-1) / (direction**2).sum(-1), 0, 1)
    return float(np.linalg.norm(offset - along[..., None] * direction, axis=-1).min(axis=1).max())


def assert_same_outline(a: Outline, b: Outline, relative: float = 1e-12) -> None:
    size = max(abs(value) for value in a.bounding_box())
    assert len(a.segments) == len(b.segments)
    # A file keeps the order of the segments, but a reader may begin with another one.
    turn = min(range(len(b.segments)), key=lambda i: math.dist(b.segments[i].start, a.segments[0].start))
    s = np.linspace(0, 1, 9)
    for one, other in zip(a.segments, b.segments[turn:] + b.segments[:turn], strict=True):
        assert type(one) is type(other)
        np.testing.assert_allclose(other.point(s), one.point(s), rtol=0, atol=relative * size)
    np.testing.assert_allclose(b.bounding_box(), a.bounding_box(), rtol=0, atol=relative * size)
    assert b.area_mm2() == pytest.approx(a.area_mm2(), rel=1e-12)


def dxf(tmp_path: Path, draw, units: int = 4, name: str = "outline.dxf") -> Path:
    document = ezdxf.new("R2010", units=units)
    draw(document.modelspace())
    document.saveas(tmp_path / name)
    return tmp_path / name


def svg(tmp_path: Path, body: str, root: str = "", head: str = "") -> Path:
    path = tmp_path / "outline.svg"
    path.write_text(f'{head}<svg xmlns="http://www.w3.org/2000/svg" {root}>{body}</svg>')
    return path


def wavy_spline(weights: np.ndarray | None = None, degree: int = 3) -> Spline:
    """A closed star-shaped spline about the origin, with inner knots one of which is double."""
    angle = np.linspace(0, 2 * np.pi, 12)
    radius = 60 + 15 * np.cos(3 * angle)
    poles = np.column_stack([radius * np.cos(angle), 1.3 * radius * np.sin(angle)])
    poles[-1] = poles[0]
    count = len(poles) - degree - 1
    inner = np.linspace(0, 2, count + 2)[1:-1]
    if count > 3:
        inner[3] = inner[2]
    return Spline(degree, np.concatenate([np.zeros(degree + 1), inner, np.full(degree + 1, 2.0)]), poles, weights)


WEIGHTS = np.array([1.0, 2, 0.5, 1, 3, 1, 0.7, 1, 1, 2, 1, 1])
SEGMENTS = [
    Line((1, 2), (-3, 4)),
    Arc((1, -2), 5.0, 0.3, 4.0),
    Arc((1, -2), 5.0, 0.3, -2.5),
    wavy_spline(),
    wavy_spline(WEIGHTS),
    wavy_spline(WEIGHTS, degree=2),
]


@st.composite
def trucks(draw):
    width, left, right = (draw(st.floats(60, 400)) for _ in range(3))
    fraction = draw(st.floats(0, 1))
    try:
        truck_outline(width, left, right, 1e9)
    except OutlineError as error:
        largest = float(re.search(r"fits is ([0-9.e+-]+) mm", str(error))[1])
    return width, left, right, max(0.01, fraction * largest * 0.9999)


def loop(points):
    return [Line(a, b) for a, b in zip(points, [*points[1:], points[0]], strict=True)]
