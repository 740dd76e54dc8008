"""What the report finds in a mirror: each figure against a closed form, the kernel, or a second way to it."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from mirror_cad.design_stages import design
from mirror_cad.deviation import Deviation, against_design
from mirror_cad.mesh import SurfaceMesh
from mirror_cad.mirror import Mirror
from mirror_cad.spec.file import load_spec
from mirror_cad.surfaces.differential import principal_curvatures, rms_norm
from mirror_studio.build.methods import with_method
from mirror_studio.build.results import LaneFigures, Manifest, Metrics
from mirror_studio.report.cut_figures import comb_figure, radius_figure
from mirror_studio.report.cuts import cuts, cuts_table
from mirror_studio.report.drawing import Panel, drawing, nice_ticks, tick_texts
from mirror_studio.report.fields import deviation_fields, deviation_in
from mirror_studio.report.histogram import histogram
from mirror_studio.report.marked_view import CURVE, TANGENT, lane_image, marked_view
from mirror_studio.report.probe import probe
from mirror_studio.report.report_data import find, write_findings
from mirror_studio.report.step_change import step_change
from mirror_studio.report.uncertainty import uncertainty
from mirror_studio.viewing_setup import ViewingSetup
from raytrace.assembly import OPTICAL_FACE
from raytrace.measures.lane import lane_straightness_percent
from raytrace.reflector import OBSTACLE_DEFLECTION_MM
from raytrace.viewing.camera import Frame
from tests.conftest import constant, designed, face_of, spec_of

FACET = np.array([[0.0, 0.0], [10.0, 0.0], [0.0, 10.0]])
# STEP holds coordinates to 13 digits or so, and the kernel evaluates poles it has read: some 1e-11 mm, and of curvature
# some 1e-8 %, which is 1e-7 mm of a radius of a metre.
SAME_MM, SAME_RADIUS_MM = 1e-9, 1e-5


def deviation_of(mirror: Mirror) -> Deviation:
    facet = SurfaceMesh(mirror.surface.evaluate(FACET[:, 0], FACET[:, 1]), np.array([[0, 1, 2]]))
    return mirror.deviation(mirror.surface, facet)


@pytest.fixture(scope="module")
def progressive() -> tuple[Mirror, Deviation]:
    mirror = designed("progressive-c")
    return mirror, deviation_of(mirror)


# --- probe points -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "method"), [("progressive-a", "decoupled"), ("progressive-c", "faithful")])
def test_probe_points_are_what_the_kernel_finds_on_the_face_in_the_file(name: str, method: Any, tmp_path: Path) -> None:
    """As a reader would: a line along z through (x, y), the face it meets, and the kernel's own point, normal and radii."""
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.BRepLProp import BRepLProp_SLProps
    from OCP.gp import gp_Dir, gp_Lin, gp_Pnt
    from OCP.IntCurvesFace import IntCurvesFace_ShapeIntersector

    from mirror_cad.occt.step import OPTICAL_FACE, read_step

    mirror = design(with_method(load_spec(name), method))
    mirror.export_step(tmp_path / "mirror.step")
    file = read_step(tmp_path / "mirror.step")
    (face,) = (each.raw for each in file.faces if each.name == OPTICAL_FACE)
    table = probe(file.optical_surface(), mirror.outline).table()
    columns = {key: np.asarray(values) for key, values in table.columns.items()}
    assert len(columns["point"]) == 25
    lines = IntCurvesFace_ShapeIntersector()
    lines.Load(face, 1e-9)
    adaptor = BRepAdaptor_Surface(face)
    for k in range(25):
        x, y = columns["x_mm"][k], columns["y_mm"][k]
        lines.Perform(gp_Lin(gp_Pnt(float(x), float(y), 500.0), gp_Dir(0, 0, -1)), 0.0, 1000.0)
        assert lines.NbPnt() == 1  # inside the outline
        theirs = BRepLProp_SLProps(adaptor, lines.UParameter(1), lines.VParameter(1), 2, 1e-9)
        point = np.array(theirs.Value().Coord())
        ours = np.array([x, y, columns["z_mm"][k]])
        assert np.abs(point - ours).max() < SAME_MM
        normal = np.array(theirs.Normal().Coord())
        facing = float(np.sign(normal[2]))
        assert np.abs(facing * normal - [columns[key][k] for key in ("nx", "ny", "nz")]).max() < 1e-11
        # The kernel counts a convex face's curvature negative along its outward normal.
        kappas = sorted((-facing * theirs.MaxCurvature(), -facing * theirs.MinCurvature()), reverse=True)
        assert np.abs(1.0 / np.array(kappas) - [columns["R1_mm"][k], columns["R2_mm"][k]]).max() < SAME_RADIUS_MM
        largest, smallest = gp_Dir(), gp_Dir()
        theirs.CurvatureDirections(largest, smallest)
        first = largest if facing * theirs.MaxCurvature() < facing * theirs.MinCurvature() else smallest
        direction = np.array([columns[f"R1_direction_{axis}"][k] for axis in "xyz"])
        # Directions follow the curvatures' own error over their difference, 1e-4/mm or more here.
        assert 1.0 - abs(float(direction @ np.array(first.Coord()))) < 1e-10
        assert columns["R1_direction_deg"][k] == pytest.approx(np.degrees(np.arctan2(direction[1], direction[0])))


def test_probe_points_are_round_inside_and_spread_over_any_outline(tmp_path: Path) -> None:
    mirror = designed("progressive-c")
    points = probe(mirror.surface, mirror.outline).points
    assert (points[:, :2] == np.round(points[:, :2])).all()  # whole millimetres, to be typed
    assert np.ptp(points[:, 0]) > 0.75 * 230.0
    assert np.ptp(points[:, 1]) > 0.75 * 327.0
    assert (np.diff(points.reshape(5, 5, 3)[..., 0], axis=1) > 0.0).all()  # rows from the left,
    assert (np.diff(points.reshape(5, 5, 3)[..., 1], axis=0) < 0.0).all()  # from the top
    svg = '<svg xmlns="http://www.w3.org/2000/svg" width="200mm" height="160mm" viewBox="-100 -80 200 160">' \
          '<path d="M-90 -70 L90 -70 L90 70 L30 70 L30 -20 L-30 -20 L-30 70 L-90 70 Z"/></svg>'  # a U turned over
    (tmp_path / "u.svg").write_text(svg)
    outline = design(spec_of(constant(1250.0), constant(1250.0), outline={"file": str(tmp_path / "u.svg")})).outline
    points = probe(designed("sphere-1250").surface, outline).points
    assert outline.contains(points[:, 0], points[:, 1]).all()


def test_radii_at_an_umbilic_have_no_direction() -> None:
    mirror = design(with_method(load_spec("sphere-950"), "faithful"))
    found = probe(mirror.surface, mirror.outline)
    assert np.abs(found.radii - 950.0).max() < 1e-3  # the fit is held to 0.01 % of curvature and reaches 1e-6 %
    flat = probe(design(spec_of(constant(np.inf), constant(np.inf))).surface, mirror.outline)
    assert np.isinf(flat.radii).all()
    assert np.isnan(flat.angles_deg).all()


# --- cuts -------------------------------------------------------------------------------------------------------------


def test_cuts_have_the_curvatures_that_the_construction_gives_them(progressive: tuple[Mirror, Deviation]) -> None:
    mirror, deviation = progressive
    rms = rms_norm(deviation.designed, deviation.grid.weights)
    found = cuts(mirror, mirror.surface, rms, "%")
    half_width, half_height = 115.0, 0.5 * (mirror.box[3] - mirror.box[2])
    assert [(cut.along, cut.at_mm) for cut in found] == [
        ("x", pytest.approx(-half_height / 3)), ("x", pytest.approx(0.0, abs=1e-9)), ("x", pytest.approx(half_height / 3)),
        ("y", pytest.approx(-half_width / 3)), ("y", pytest.approx(0.0, abs=1e-9)), ("y", pytest.approx(half_width / 3))]
    tolerance = 1e-4  # relative: the fit's 0.01 % of curvature
    for cut in found:
        inside = np.isfinite(cut.position)
        assert inside.sum() > 200
        x = cut.points[inside, 0]
        if cut.along == "y":  # a circle of radius Ry in the plane x = const, by construction
            wanted = mirror.curvature.vertical(x)
            assert np.abs(cut.plane_curvature[inside] / wanted - 1.0).max() < tolerance
            # Meusnier: the normal section's is smaller by the cosine of the normal's tilt out of the plane.
            d = mirror.surface.derivatives(x, cut.points[inside, 1])
            cosine = np.sqrt(1.0 + d["v"][:, 2] ** 2) / np.sqrt(1.0 + d["u"][:, 2] ** 2 + d["v"][:, 2] ** 2)
            assert np.abs(cut.realised.w22[inside] / cut.plane_curvature[inside] / cosine - 1.0).max() < 1e-12
        elif cut.at_mm == 0.0:  # the profile itself
            assert np.abs(cut.plane_curvature[inside] / mirror.curvature.horizontal(x) - 1.0).max() < tolerance
        again = deviation_in("%", cut.realised, cut.designed, rms)
        assert np.nanmax(np.abs(again.kx - cut.deviation["kx"])) == 0.0
    columns = cuts_table(found).columns
    assert len(columns["x_mm"]) == sum(int(np.isfinite(cut.position).sum()) for cut in found)
    assert np.isfinite(np.asarray(columns["section_curvature_per_m"])).all()


def test_limit_band_is_the_limit_in_curvature_and_is_drawn(progressive: tuple[Mirror, Deviation]) -> None:
    raw = load_spec("progressive-c").model_copy(update={"limits": spec_of(constant(1.0e3), constant(1.0e3), limits={
        "curvature_percent": 4.0}).limits})
    mirror = design(raw)
    rms = rms_norm(progressive[1].designed, progressive[1].grid.weights)
    limited, free = (cuts(one, one.surface, rms, "%") for one in (mirror, progressive[0]))
    assert free[0].band is None
    band = limited[1].band
    assert band is not None
    designed_kx = limited[1].designed.w11
    assert np.nanmax(np.abs(band["kx"][1] / designed_kx - 1.04)) < 1e-12
    assert np.nanmax(np.abs(band["kx"][0] / designed_kx - 0.96)) < 1e-12
    with_band, without = radius_figure(limited[:3], 4.0).decode(), radius_figure(free[:3], None).decode()
    assert "±4\u202f% of curvature" in with_band
    assert with_band.count("fill-opacity") - without.count("fill-opacity") == 6  # two laws, three cuts
    assert "nan" not in with_band + without + comb_figure(free).decode()


# --- how far the figures may be off -----------------------------------------------------------------------------------


def test_refined_grid_says_how_much_the_largest_deviation_was_missed(progressive: tuple[Mirror, Deviation]) -> None:
    mirror, deviation = progressive
    fields = deviation_fields(deviation, None)
    found = uncertainty(mirror, deviation, mirror.surface, fields)
    assert found.points[0] == int(deviation.grid.inside.sum())
    assert found.finer[0] == pytest.approx(4 * found.points[0], rel=0.01)
    entry = against_design(mirror.curvature, mirror.outline, mirror.exact, mirror.surface)
    # All along the edge, where the largest k1, k2 of this mirror are, a hundred times closer than the refined grid.
    edge = np.concatenate([segment.point(np.linspace(0.0, 1.0, 40_000)) for segment in mirror.outline.segments])
    w = principal_curvatures(mirror.surface, edge[:, 0], edge[:, 1])
    pair = np.sort(np.stack([mirror.curvature.horizontal(edge[:, 0]), mirror.curvature.vertical(edge[:, 0])], axis=1))[:, ::-1]
    true = np.abs(100.0 * (w - pair) / pair).max(axis=0)
    for k, key in enumerate(("k1", "k2")):
        coarse, fine = found.largest[key]
        assert coarse == pytest.approx(abs(entry.of(key).max_percent), rel=1e-12)
        assert 0.0 <= true[k] - fine <= true[k] - coarse + 1e-12  # refining comes closer, from below
        assert true[k] - fine < found.missed(key) + 1e-6
    assert found.rounding_per_m < 1e-8  # float64 in second derivatives over 230 mm
    assert found.quadrature_mm is not None
    assert found.quadrature_mm < 1e-12
    assert found.quadrature_percent is not None
    assert found.quadrature_percent < 1e-8


# --- histogram, STEP, lane --------------------------------------------------------------------------------------------


def test_histogram_counts_all_of_the_area(progressive: tuple[Mirror, Deviation]) -> None:
    _, deviation = progressive
    fields = deviation_fields(deviation, None)
    shares = histogram(deviation, fields)
    for key, share in shares.share.items():
        assert share.sum() == pytest.approx(100.0, abs=1e-9), key
    weights, values = deviation.grid.weights, fields.values["k2"]
    bin_of_most = int(np.argmax(shares.share["k2"]))
    low, high = shares.edges[bin_of_most: bin_of_most + 2]
    by_hand = 100.0 * weights[(values >= low) & (values < high)].sum() / weights.sum()
    assert shares.share["k2"][bin_of_most] == pytest.approx(by_hand)


def test_step_table_compares_what_was_written_with_what_was_read(progressive: tuple[Mirror, Deviation],
                                                                 tmp_path: Path) -> None:
    mirror, deviation = progressive
    plate = mirror.export_steps_apart(tmp_path / "mirror.step", tmp_path / "sheet.step", OBSTACLE_DEFLECTION_MM, lambda: None)
    face = plate.step.named(OPTICAL_FACE)
    found = step_change(mirror, deviation, face.surface, (plate.area_mm2, face.area_mm2))
    rows = {row.name: row for row in found.rows}
    assert (rows["degree along x"].before, rows["poles along y"].after) == (mirror.surface.degree_u,
                                                                            mirror.surface.poles.shape[1])
    assert found.poles_mm is not None
    assert 0.0 <= found.poles_mm < SAME_MM
    area = rows["area of the optical face"]
    assert area.after == pytest.approx(area.before, rel=1e-9)
    assert area.before == mirror.plate.area_mm2


def test_lane_image_is_the_lane_and_its_tangent_gives_the_straightness(progressive: tuple[Mirror, Deviation]) -> None:
    mirror, _ = progressive
    setting = ViewingSetup.of(mirror.spec, mirror.box)
    straightness = lane_straightness_percent(face_of(mirror), setting.eye, setting.lane, mirror.box)
    image = lane_image(face_of(mirror), setting.eye, setting.lane, mirror.box, straightness)
    assert image is not None
    above = setting.lane.above(*face_of(mirror).reflected_at(setting.eye, image.x, image.y))
    assert np.abs(above).max() < 1e-6  # mm on the plane 8.2 m behind, from roots to 1e-11 mm on the mirror
    curve, line = image.y[-1] - image.y[0], image.tangent[-1] - image.tangent[0]
    assert 100.0 * (abs(curve) - abs(line)) / abs(line) == pytest.approx(straightness, rel=1e-9)
    # It touches the curve at the right edge: one column on, by the image's bend alone.
    steps = image.y[:3] - image.tangent[:3]
    assert steps[0] == 0.0
    assert steps[2] / steps[1] == pytest.approx(4.0, abs=0.6)
    assert lane_image(face_of(mirror), setting.eye, setting.lane, mirror.box, None) is None

    frame = Frame.around(mirror.box, 400)
    plain = np.full((frame.rows, frame.columns, 3), 128, dtype=np.uint8)
    marked = np.asarray(Image.open(io.BytesIO(marked_view(plain, frame, image, face_of(mirror), setting.eye))))
    for colour in (CURVE, TANGENT):
        assert (np.abs(marked.astype(int) - np.array(colour)).sum(axis=2) < 90).sum() > 100
    # In the frame the picture plane is z = 0: a point of the mirror is seen there along its ray.
    middle = len(image.x) // 2
    p = mirror.surface.evaluate(image.x[middle], image.y[middle])
    on_plane = setting.eye + (p - setting.eye) * setting.eye[2] / (setting.eye[2] - p[2])
    column, row = (on_plane[0] - frame.left) / frame.pixel, (frame.top - on_plane[1]) / frame.pixel
    around = marked[int(row) - 1: int(row) + 2, int(column) - 1: int(column) + 2].astype(int)
    assert (np.abs(around - np.array(CURVE)).sum(axis=2) < 150).any()
    # JPEG changes a grey by a unit or two, the marks nothing but their own places.
    assert np.abs(marked[-40:, :40].astype(int) - 128).max() <= 3


# --- files ------------------------------------------------------------------------------------------------------------


def test_all_figures_are_in_csv_and_json_with_the_same_digits(progressive: tuple[Mirror, Deviation],
                                                              tmp_path: Path) -> None:
    mirror, deviation = progressive
    metrics = Metrics(lane_straightness_percent=LaneFigures(traced=40.9))
    findings = find(mirror, deviation, mirror.surface, metrics)
    write_findings(tmp_path, mirror, deviation, findings, Manifest(spec={}))
    text = (tmp_path / "progressive-c-report.json").read_text("utf-8")
    content = json.loads(text, parse_constant=lambda word: pytest.fail(f"{word} in JSON"))
    assert content["schema"] == 1
    assert (content["file"], content["face"]) == ("progressive-c.step", "optical face")
    assert (content["head"]["number"], content["head"]["spec"]) == (None, "progressive-c")
    assert content["verdicts"]["view"] is None  # nothing is asked of it
    assert list(content["tables"]) == ["verdicts", "sampling", "maps", "histogram", "sections", "stages", "step", "probe",
                                       "measures", "lane"]
    measured = dict(zip(*content["tables"]["measures"].values(), strict=True))
    assert {name: value for name, value in measured.items() if value} == {"lane_straightness_percent.traced": 40.9}
    for name, columns in content["tables"].items():
        with (tmp_path / f"progressive-c-{name}.csv").open(encoding="utf-8", newline="") as stream:
            header, *rows = csv.reader(stream)
        assert header == list(columns)
        assert {len(column) for column in columns.values()} == {len(rows)}
        for row, values in zip(rows, zip(*columns.values(), strict=True), strict=True):
            for text, value in zip(row, values, strict=True):
                assert text == "" if value is None else (value == text or json.loads(text) == value)
    maps = {key: np.array(values) for key, values in content["tables"]["maps"].items()}
    assert np.abs(np.stack([maps["x_mm"], maps["y_mm"]], axis=1) - mirror.grid_points()[:, :2]).max() < 1e-9
    k = 1e3 * principal_curvatures(mirror.surface, maps["x_mm"], maps["y_mm"])
    assert np.abs(np.stack([maps["k1_realised_per_m"], maps["k2_realised_per_m"]], axis=1) - k).max() < 1e-9
    assert maps["kx_realised_per_m"] - maps["kx_designed_per_m"] == pytest.approx(maps["kx_deviation_per_m"], abs=1e-9)
    stages = content["tables"]["stages"]
    at = list(zip(stages["stage"], stages["quantity"], strict=True)).index(("total", "k2"))
    assert stages["max_percent"][at] == pytest.approx(deviation.total.k2.max_percent, rel=1e-11)


# --- drawings ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("low", "high", "most"), [(0.0, 1.0, 5), (-4.6, 3.2, 6), (1249.97, 1250.02, 4), (-1e-9, 3e-9, 3),
                                                   (1e6, 3.3e6, 3), (0.1, 0.11, 1), (-3.0, 9000.0, 7)])
def test_ticks_are_round_few_and_told_apart(low: float, high: float, most: int) -> None:
    ticks = nice_ticks(low, high, most)
    assert 1 <= len(ticks) <= most
    if len(ticks) > 1:
        steps = np.diff(ticks)
        assert steps == pytest.approx(steps[0], rel=1e-6)
        mantissa = steps[0] / 10.0 ** np.floor(np.log10(steps[0]) + 1e-9)
        assert min(abs(mantissa - nice) for nice in (1.0, 2.0, 5.0)) < 1e-6
        assert len(ticks) > most / 3.5  # the next finer step would have been too fine
    assert all(low - 1e-9 * (high - low) <= tick <= high + 1e-9 * (high - low) for tick in ticks) or len(ticks) == 1
    assert len(set(tick_texts(ticks))) == len(ticks)


def test_drawn_lines_lie_where_their_values_are_and_break_where_there_are_none() -> None:
    from xml.etree import ElementTree

    panel = Panel(100.0, 50.0, 200.0, 100.0, (0.0, 2.0), (-1.0, 1.0))
    panel.line([0.0, 1.0, np.nan, 1.5, 2.0], [-1.0, 0.0, 0.0, 0.0, 1.0], "#000")
    (path,) = panel.parts
    assert "M100.0 150.0L200.0 100.0 M250.0 100.0L300.0 50.0" in path
    panel.band([0.0, 2.0], [-1.0, -1.0], [1.0, 1.0], "#b35806", 0.2)
    root = ElementTree.fromstring(drawing(200.0, [panel.svg(0, "a < b", "x, mm", "y")]))
    assert any(element.text == "a < b" for element in root.iter() if element.tag.endswith("text"))
