"""The paper's figures from the files of a build, and what the driver's picture promises."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mirror_cad
import raytrace
from mirror_studio.as_json import table1_as_json
from mirror_studio.build.paper import PAPER, table_1
from mirror_studio.build.results import FieldOfView, LaneFigures, Metrics
from raytrace.image import landing_points, photograph
from raytrace.measures.difference import reflected_difference
from raytrace.measures.lane import lane_straightness_percent
from raytrace.measures.lane_image import YELLOWNESS, _runs, lane_straightness_in_picture
from raytrace.measures.straight_lane import StraightLane
from raytrace.scene.reference import BACKGROUND, ReferencePlane, load_picture
from raytrace.viewing.camera import Frame, rays_through
from raytrace.viewing.eye import eye_position
from tests.conftest import constant, designed, face_of, spec_of


def setting(mirror: mirror_cad.Mirror, picture: np.ndarray) -> tuple[np.ndarray, ReferencePlane]:
    eye = eye_position(762.0, "right", mirror.box)
    return eye, ReferencePlane(picture, float(eye[2]) + 8200.0, 9000.0, (-2300.0, 0.0))


@pytest.mark.parametrize("name", ["progressive-a", "progressive-b", "progressive-c"])
def test_lane_measured_in_the_picture_is_the_traced_one_within_a_point(name: str) -> None:
    mirror = designed(name)
    eye, scene = setting(mirror, load_picture("road"))
    reflector = raytrace.Reflector.from_mirror(mirror)
    frame = Frame.around(mirror.box, 1280)
    view, _ = photograph(reflector, frame.camera(eye), scene)
    in_picture = lane_straightness_in_picture(view, frame, reflector, eye, mirror.box)
    traced = lane_straightness_percent(face_of(mirror), eye, StraightLane(0.0, 2400.0, 0.6, scene.z_mm), mirror.box)
    assert in_picture == pytest.approx(traced, abs=1.0)


def test_picture_without_a_yellow_line_has_no_straightness() -> None:
    mirror = designed("sphere-1250")
    eye, scene = setting(mirror, np.full((120, 100, 3), 90, dtype=np.uint8))
    reflector = raytrace.Reflector.from_mirror(mirror)
    frame = Frame.around(mirror.box, 200)
    view, _ = photograph(reflector, frame.camera(eye), scene)
    assert lane_straightness_in_picture(view, frame, reflector, eye, mirror.box) is None


def test_a_plane_mirror_shows_the_picture_reversed_left_to_right_and_keeps_its_values() -> None:
    """A picture whose values are linear in X and Y: each pixel has the value of the plane's point that it shows."""
    mirror = mirror_cad.design(spec_of(constant(np.inf), constant(np.inf)))
    rows, columns = 1080, 900
    picture = np.empty((rows, columns, 3), dtype=np.uint8)
    picture[..., 0] = np.linspace(10, 240, columns)[None, :]  # rises towards the picture's right, which lies at −X
    picture[..., 1] = np.linspace(240, 10, rows)[:, None]  # rises towards the top
    picture[..., 2] = 77
    eye, scene = setting(mirror, picture)
    frame = Frame.around(mirror.box, 230)
    view, counts = photograph(raytrace.Reflector.from_mirror(mirror), frame.camera(eye), scene)
    row, column = frame.rows // 3, np.arange(30, 200, 10)
    trace = raytrace.reflect(raytrace.Reflector.from_mirror(mirror), eye,
                             rays_through(frame, eye, column + 0.5, np.full(column.shape, row + 0.5)))
    landed = landing_points(trace, scene.z_mm)
    x_min, x_max, y_min, y_max = scene.bounds()
    expected_red = 10 + 230 * ((x_max - landed[:, 0]) / (x_max - x_min) * columns - 0.5) / (columns - 1)
    expected_green = 10 + 230 * (1 - ((y_max - landed[:, 1]) / (y_max - y_min) * rows - 0.5) / (rows - 1))
    # Values are whole numbers in the picture and in the view: one unit.
    assert np.abs(view[row, column, 0] - expected_red).max() <= 1.0
    assert np.abs(view[row, column, 1] - expected_green).max() <= 1.0
    assert (view[row, column, 2] == 77).all()
    assert view[row, 30, 0] > view[row, 190, 0]  # the mirror's left shows −X, where the picture's right is
    assert (view[0, 0] == BACKGROUND.astype(np.uint8)).all()
    assert set(counts) == {"missed", "reflected"}


def test_frame_is_the_box_with_a_twentieth_of_its_width_around() -> None:
    frame = Frame.around((-115.0, 115.0, -163.0, 163.0), 1280)
    assert frame.pixel == pytest.approx(253.0 / 1280)
    assert frame.left == pytest.approx(-126.5)
    assert frame.top == pytest.approx(174.5)
    assert frame.rows == round(349.0 / frame.pixel)


def test_lane_of_the_picture_is_the_contract_line() -> None:
    """The yellow line of the built-in picture lies on Y = 2400 + 0.6·X of the reference plane."""
    picture = load_picture("road").astype(float)
    rows, columns = picture.shape[:2]
    scale = 9000.0 / columns
    yellowness = np.minimum(picture[..., 0], picture[..., 1]) - picture[..., 2]
    for x in range(-6600, 1900, 250):
        column = round((2200.0 - x) / scale - 0.5)
        at = 2200.0 - (column + 0.5) * scale
        yellow = np.flatnonzero(yellowness[:, column] > 60)
        top = yellow[: 1 + int(np.argmax(np.diff(np.append(yellow, 10**9)) > 1))]
        y = 0.5 * rows * scale - (np.average(top, weights=yellowness[top, column]) + 0.5) * scale
        assert y == pytest.approx(2400.0 + 0.6 * at, abs=4.0)  # one picture element


def test_facets_of_the_stl_miss_by_many_millimetres_on_the_plane(tmp_path: Path) -> None:
    mirror = designed("progressive-c")
    mirror.export_stl(tmp_path / "c.stl")
    eye, scene = setting(mirror, np.zeros((2, 2, 3), dtype=np.uint8))
    apart = reflected_difference(raytrace.load_reflector(tmp_path / "c.stl"), raytrace.Reflector.from_mirror(mirror), eye,
                                 scene.z_mm, mirror.box)
    # Normals 0.1 to 0.3 degrees off turn rays by twice that, over 9 m: tens of millimetres.
    assert 20.0 < apart.plane_max_mm < 400.0
    assert 5.0 < apart.plane_rms_mm < apart.plane_max_mm


def test_table_1_takes_section_fields_of_view_and_the_traced_lane() -> None:
    metrics = {name: Metrics(FieldOfView(section=1.0, traced=9.0), FieldOfView(section=2.0, traced=9.0),
                             LaneFigures(traced=3.0, image=9.0)) for name in PAPER}
    table = table1_as_json(table_1(metrics))
    assert table["progressive-b"] == {"h_fov_deg": {"ours": 1.0, "paper": 44.8}, "v_fov_left_deg": {"ours": 2.0, "paper": 46.8},
                                      "lane_straightness_percent": {"ours": 3.0, "paper": 30.0}}


def test_yellow_runs_of_all_columns_are_those_of_each() -> None:
    rng = np.random.default_rng(4)
    for _ in range(200):
        rows, columns = rng.integers(1, 12, 2)
        yellowness = rng.choice(np.array([-30, 0, 20, 60, 255], dtype=np.int16), (rows, columns))
        expected = [_runs_of_one(yellowness[:, c]) for c in range(columns)]
        found = _runs(yellowness)
        assert len(found) == columns
        assert all(np.array_equal(a, b) for a, b in zip(found, expected, strict=True))  # sums of whole numbers are exact


def _runs_of_one(column: np.ndarray) -> list[float]:
    centres, row = [], 0
    while row < len(column):
        start = row
        while row < len(column) and column[row] > YELLOWNESS:
            row += 1
        if row > start:
            part = range(max(start - 1, 0), min(row + 1, len(column)))
            weights = [max(int(column[i]), 0) for i in part]
            centres.append(sum(i * weight for i, weight in zip(part, weights, strict=True)) / sum(weights))
        row += 1
    return centres
