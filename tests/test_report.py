"""Designed mirrors in, what their report and the paper's index must and must not hold out."""

from __future__ import annotations

import base64
import hashlib
import io
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mirror_cad import laws
from mirror_cad.curvature_fields import QUANTITIES
from mirror_cad.design_stages import design
from mirror_cad.deviation import Deviation, RayDeviation
from mirror_cad.mesh import SurfaceMesh
from mirror_cad.mirror import Mirror
from mirror_cad.spec.file import load_spec, validate_spec
from mirror_cad.stage_deviation import StageDeviation
from mirror_cad.surfaces.differential import rms_norm, shape_operator
from mirror_cad.surfaces.faithful import FaithfulLevel
from mirror_studio.as_json import requirements_as_json
from mirror_studio.build.methods import compare_methods, with_method
from mirror_studio.build.results import (
    Built,
    Compared,
    FieldOfView,
    FileChecks,
    LaneFigures,
    Manifest,
    MethodComparison,
    Metrics,
    OnPlane,
    PaperRow,
    PlateFigures,
    StepCheck,
)
from mirror_studio.report import fields
from mirror_studio.report.colours import BLUE_ORANGE, VIRIDIS
from mirror_studio.report.maps import pair_maps, radius_ticks
from mirror_studio.report.page import write_report
from mirror_studio.report.paper_page import contact_sheet, table1_markdown, write_index
from mirror_studio.report.report_data import find
from mirror_studio.report.requirement import Requirement
from mirror_studio.report.rows import requirement_groups
from mirror_studio.report.side_by_side import exchange_sentences, side_by_side
from mirror_studio.report.stages import Floor, Link, chain_links, model_sentences, stage_rows, weakest_sentence
from mirror_studio.report.text import fixed, given, number, point_in_words
from mirror_studio.report.uncertainty import Uncertainty
from mirror_studio.report.verdict_table import requirements, view_requirements
from raytrace.scene.reference import Picture

METRICS = Metrics(
    h_fov_deg=FieldOfView(section=44.82, traced=44.63), v_fov_left_deg=FieldOfView(section=42.88, traced=39.6),
    lane_straightness_percent=LaneFigures(traced=40.91, image=None), stl_on_plane=OnPlane(310.0, 95.0, 12345),
    rays={"reflected": 15_000_000, "missed": 10}, eye_mm=(115.0, 0.0, 753.27),
    plate=PlateFigures(area_mm2=68985.3, volume_mm3=2.1e5, back_error_mm=4e-6),
    files=FileChecks(StepCheck(3e-11, 4e-11, 1e-12), 2e-11, 1e-13, 2700))
MANIFEST = Manifest(versions={"mirror-cad": "0.1.0"}, notes=("read <b>a&b</b>",), files={"mirror.step": "ab" * 32})
Designed = tuple[Mirror, Deviation]
FLAT = {"law": "constant", "radius_mm": math.inf}
TURNING = {"law": "expression", "curvature": "0.001*(t - 0.4)"}


def _picture() -> Picture:
    return np.full((88, 64, 3), 128, dtype=np.uint8)


def _deviation(mirror: Mirror) -> Deviation:
    """As if STEP had changed nothing and the STL were one facet: the kernel has its own tests."""
    corners = np.array([[0.0, 0.0], [10.0, 0.0], [0.0, 10.0]])
    facet = SurfaceMesh(mirror.surface.evaluate(corners[:, 0], corners[:, 1]), np.array([[0, 1, 2]]))
    return mirror.deviation(mirror.surface, facet)


@pytest.fixture(scope="module")
def limited() -> Designed:
    raw = load_spec("progressive-c").model_dump(exclude_none=True, exclude={"outline"})
    mirror = design(validate_spec(raw | {"limits": {"curvature_percent": 3.0}}))
    return mirror, _deviation(mirror)


@pytest.fixture(scope="module")
def plane() -> Designed:
    mirror = design(validate_spec({"name": "plane", "horizontal": FLAT, "vertical": FLAT}))
    return mirror, _deviation(mirror)


@pytest.fixture(scope="module")
def faithful() -> Designed:
    mirror = design(with_method(load_spec("progressive-a"), "faithful"))
    return mirror, _deviation(mirror)


@pytest.fixture(scope="module")
def methods(faithful: Designed) -> MethodComparison:
    mirror, _ = faithful
    return compare_methods(mirror)


def _report(folder: Path, designed: Designed, metrics: Metrics, manifest: Manifest) -> str:
    findings = find(*designed, designed[0].surface, metrics)
    write_report(folder / "report.html", *designed, metrics, manifest, _picture(), findings)
    return (folder / "report.html").read_text("utf-8")


def _readable(page: str) -> str:
    """What a reader meets: the page without its pictures and style."""
    text = re.sub(r"data:[a-z/+]+;base64,[A-Za-z0-9+/=]+|<style>.*?</style>", "", page, flags=re.DOTALL)
    return re.sub(r"[ \n]+", " ", text)


def _check_plain(page: str) -> None:
    text = _readable(page)
    assert not re.search(r"https?://|<script|src=\"(?!\")[^\"]", text)
    assert not re.search(r"\b(nan|NaN|None|null|inf|True|False)\b", text)


def _missing(text: str, *phrases: str) -> list[str]:
    return [phrase for phrase in phrases if phrase not in text]


def test_report_holds_its_figures_and_nothing_from_outside(tmp_path: Path, limited: Designed) -> None:
    page = _report(tmp_path, limited, METRICS, MANIFEST)
    _check_plain(page)
    text = _readable(page)
    assert page.count("data:image/") == 8
    assert len(page) < 2.5e6
    assert not _missing(text, "Tolerances met", "Beyond the limit of ±3\u202f%", "of the area lies beyond",
                        "the part that no numerics can remove", "44.82°", "39.60°", "40.9\u202f%", "68\u202f985\u202fmm²",
                        "3.0·10⁻¹¹\u202fmm", "ab" * 32, "0.5865 (solved for)", "read &lt;b&gt;a&amp;b&lt;/b&gt;")


def test_head_names_part_day_and_hashes_and_leaves_lines_to_sign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1400000000")
    part = {"number": "A 47 <b>\\", "revision": "C\"2", "title": "Main mirror", "hand": "right"}
    raw = load_spec("sphere-950").model_dump(exclude_none=True, exclude={"outline"})
    mirror = design(validate_spec(raw | {"part": part}))
    both = mirror, _deviation(mirror)
    files = {f"{mirror.spec.name}{end}": "cd" * 32 for end in (".step", "-surface.step", ".stl", "-points.csv")}
    page = _report(tmp_path, both, METRICS, replace(MANIFEST, spec={"name": "x"}, files=files | {"metrics.json": "ef" * 32}))
    _check_plain(page)
    text = _readable(page)
    assert not _missing(text, "A 47 &lt;b&gt;\\", "<b>C&#34;2</b>", "Main mirror", "2014-05-13", "made", "checked", "approved",
                        hashlib.sha256(b'{"name":"x"}').hexdigest(), "nothing in this report was measured on glass")
    # What is signed stands before the lines to sign on, the rest at the end.
    places = [text.index(words) for words in ("cd" * 32, ">approved<", ">Verdicts<", "ef" * 32)]
    assert places == sorted(places)
    # The laws and the eye are those of the left-hand mirror; the files are its reflection.
    assert "The files are the reflection in x = 0 of the design" in text
    assert "said to be" not in text
    inside_out = design(validate_spec(raw | {"part": part, "eye": {"aligned": "left"}}))
    wrong = _readable(_report(tmp_path, (inside_out, both[1]), METRICS, MANIFEST))
    assert "said to be a right-hand mirror" in wrong
    assert "reflected twice" in wrong
    style = re.search(r"@page \{\n  @top-left.*", page)
    assert style is not None
    assert "\\3c b\\3e \\5c " in style.group(0)  # of "<b>\\", as a CSS string holds it
    assert "said to be" not in _readable(_report(tmp_path, (design(load_spec("sphere-950")), both[1]), METRICS, MANIFEST))


def test_verdicts_have_limit_actual_margin_and_place(tmp_path: Path, limited: Designed) -> None:
    mirror, deviation = limited
    rows = {row.name: row for row in requirements(mirror, deviation, METRICS)}
    k2 = rows["k2, realised against designed"]
    assert (k2.limit, k2.actual, k2.met) == (3.0, deviation.total.k2.max_percent, False)
    assert k2.margin == pytest.approx(3.0 - abs(deviation.total.k2.max_percent))
    assert k2.point == deviation.total.k2.max_at_mm
    assert rows["fit: height"].limit == mirror.spec.surface.position_tolerance_mm
    assert rows["fit: height"].met
    assert rows["STEP read back by the kernel, farthest point"].actual == METRICS.files.step.step_max_mm
    text = _readable(_report(tmp_path, limited, METRICS, MANIFEST))
    assert not _missing(text, ">not met<", "−1.64\u202f%", "±3\u202f%", "x\u202f87.70, y\u202f161.38\u202fmm")
    # A margin that the grid cannot be sure of is said to be one.
    close = Requirement("part", "k1, realised against designed", "%", 3.0, 2.9999)
    coarse = Uncertainty((211, 311), (1, 1), (421, 621), (1, 1), dict.fromkeys(QUANTITIES, (1.0, 1.01)), "%", 0.0, None,
                         None)
    (_, [row]), *_ = requirement_groups([close], coarse)
    assert row["verdict"] == "met, but closer than the grid tells"


def test_without_a_number_none_is_stated(tmp_path: Path, limited: Designed) -> None:
    text = _readable(_report(tmp_path, limited, METRICS, MANIFEST))
    assert not _missing(text, "<th>Part number</th><td>none stated</td>", "<h1>progressive-c</h1>",
                        "progressive-c-report.json", "progressive-c-verdicts.csv", "part of a set of files")


def test_deviation_at_a_printed_place_is_the_printed_one(limited: Designed, faithful: Designed) -> None:
    for mirror, deviation in (limited, faithful):
        rms = rms_norm(deviation.designed, deviation.grid.weights)
        for key in QUANTITIES:
            printed = point_in_words(deviation.total.of(key).max_at_mm).replace("\u2212", "-").replace("\u202f", "")
            x, y = (np.array([float(part[1:])]) for part in printed.split(", "))
            found = getattr(fields.deviation_in("%", shape_operator(mirror.surface.derivatives(x, y)),
                                                mirror.curvature.shape(x), rms), key)
            assert number(float(found[0])) == number(deviation.total.of(key).max_percent)


def test_radii_are_coloured_by_curvature_and_the_scale_tells_them_in_mm(limited: Designed) -> None:
    mirror, deviation = limited
    rx = fields.pairs_of(deviation)[0]
    maps = re.findall("base64,([^\"]*)", pair_maps(deviation, mirror.outline, [rx]).decode())
    assert len(maps) == 2  # designed and realised
    picture = np.asarray(Image.open(io.BytesIO(base64.b64decode(maps[1]))).convert("RGB")).astype(int)
    yellow, purple = (np.nonzero(np.abs(picture[len(picture) // 2] - colour).max(axis=1) < 12)[0]  # along the middle row
                      for colour in ([253, 231, 37], [68, 1, 84]))
    assert yellow.min() < purple.min()  # 400 mm at the left edge, 1250 mm at the right
    ticks = radius_ticks(*rx.scale())
    assert {600.0, 800.0, 1000.0} <= set(ticks)
    apart = np.abs(np.diff(1.0 / np.array(ticks))) / (1.0 / 400.0 - 1.0 / 1250.0)
    assert apart.min() > 0.05
    assert radius_ticks(-900.0, -300.0) == [-tick for tick in reversed(radius_ticks(300.0, 900.0))]
    assert radius_ticks(949.9995, 950.0005)
    js = (Path(pair_maps.__code__.co_filename).parents[1] / "web" / "js" / "colours.js").read_text("utf-8")
    for name, ours in (("sequential", VIRIDIS), ("diverging", BLUE_ORANGE)):  # the page's
        (stops,) = re.findall(rf"{name}: \[(.*?)\]", js)
        assert tuple(re.findall(r"#[0-9a-f]{6}", stops)) == ours


def test_limits_of_the_view_are_rows_with_margins_and_a_verdict(tmp_path: Path) -> None:
    raw = load_spec("sphere-950").model_dump(exclude_none=True, exclude={"outline"})
    asked = {"h_fov_deg": [44.0, math.inf], "v_fov_left_deg": [40.0, 42.5], "lane_straightness_percent": [-math.inf, 50.0]}
    mirror = design(validate_spec(raw | {"limits": asked}))
    rows = [(row.side, row.limit, row.actual, row.met) for row in view_requirements(mirror, METRICS)]
    assert rows == [("least", 44.0, 44.82, True), ("least", 40.0, 42.88, True), ("most", 42.5, 42.88, False),
                    ("most", 50.0, 40.91, True)]
    (_, _, missed, _) = requirements_as_json(view_requirements(mirror, METRICS))
    assert missed["margin"] == pytest.approx(-0.38)
    text = _readable(_report(tmp_path, (mirror, _deviation(mirror)), METRICS, MANIFEST))
    assert not _missing(text, "at least 44°", "at most 42.5°", "−0.38°", "9.09\u202f%", "44, ∞",
                        "✗ Beyond what is asked: vertical field of view at the left edge, section")
    # What cannot be measured is not met.
    unknown = [row.met for row in view_requirements(mirror, replace(METRICS, lane_straightness_percent=LaneFigures()))]
    assert unknown == [True, True, False, False]
    assert requirements_as_json(view_requirements(mirror, Metrics()))[0]["actual"] is None
    _check_plain(_report(tmp_path, (mirror, _deviation(mirror)), replace(METRICS, h_fov_deg=FieldOfView()), MANIFEST))


def test_the_same_mirror_gives_the_same_page(tmp_path: Path, limited: Designed, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1400000000")
    again = design(limited[0].spec)
    pages = [_report(tmp_path, one, METRICS, MANIFEST) for one in (limited, (again, _deviation(again)))]
    assert pages[0] == pages[1]


def test_report_of_a_plane_without_measurements(tmp_path: Path, plane: Designed) -> None:
    page = _report(tmp_path, plane, Metrics(), Manifest())
    _check_plain(page)
    assert not _missing(page, "The design is flat", "Rx and Ry are flat", "No limit asked for")


def test_report_names_the_method_and_what_its_deviation_comes_from(
        tmp_path: Path, limited: Designed, faithful: Designed) -> None:
    phrases = {
        "decoupled": ["hangs circles of radius Ry(x)", "which is the model itself", "at the stated limit of 3\u202f%"],
        "faithful": ["Gauss and Codazzi", "Refining the spans from 6\u202f×\u202f5 to ", "point and normal at the origin held",
                     "as no limit is stated", "Least squares, 6\u202f×\u202f5 spans of degree 5",
                     "least squares on 6\u202f×\u202f5, then"]}
    for designed, method in ((limited, "decoupled"), (faithful, "faithful")):
        text = _readable(_report(tmp_path, designed, METRICS, MANIFEST))
        assert not _missing(text, f"From the exact {method} surface", f"{method.capitalize()} surface, realised",
                            f"<td colspan=\"3\">{method}:", f"<td>{method}:", f"the exact {method} surface against the design",
                            "nothing is left unexplained", *phrases[method])
        assert "Decoupled and faithful" not in text


@pytest.mark.parametrize("which", ["limited", "faithful", "plane"])
def test_stage_table_has_absolute_figures_and_places_beside_percent(which: str, request: pytest.FixtureRequest) -> None:
    mirror, deviation = request.getfixturevalue(which)
    rows = {row.name: row for row in stage_rows(deviation, mirror.spec.surface.method)}
    assert list(rows) == ["model", "integration", "fit", "STEP", "total"]
    for row in rows.values():
        assert len(row.cells) == 6
        assert all(cell.per_m.endswith("/m") for cell in row.cells)
        assert row.sag.endswith("mm")
        assert row.slope.endswith("″")
        if which == "plane":
            assert {cell.max for cell in row.cells} == {cell.rms for cell in row.cells} == {"—"}
    shape = rows["total"].cells[-1]
    if which != "plane":
        assert (shape.max, shape.per_m) == (f"{number(deviation.total.shape.max_percent)}\u202f%",
                                                  f"{number(deviation.total.shape.max_per_m)}\u202f/m")
        assert shape.place.startswith("x\u202f")
    # The faithful surface moves the height, which the decoupled one is measured from.
    assert (rows["model"].sag == "0\u202fmm") == (which != "faithful")
    assert (rows["model"].sag_place == "—") == (which != "faithful")


def test_both_methods_stand_side_by_side_and_the_exchange_is_said_from_the_numbers(
        tmp_path: Path, faithful: Designed, methods: MethodComparison) -> None:
    page = _report(tmp_path, faithful, replace(METRICS, methods=methods), MANIFEST)
    _check_plain(page)
    shown = side_by_side(methods, "faithful", 8200.0)
    assert shown is not None
    assert shown.columns == [("decoupled", False), ("faithful", True)]
    decoupled, other = methods.both()
    assert dict(shown.curvatures)["shape"][1][0] == f"{number(other.deviation.shape.rms_percent)}\u202f%"
    lanes = [fixed(one.lane_straightness_percent, 1) for one in (decoupled, other)]
    assert not _missing(_readable(page), "Decoupled and faithful", "faithful (built)", "comes 2.2 times closer",
                        f"the lane bends more: {lanes[0]}\u00a0→\u00a0{lanes[1]}\u202f%", "narrower upright at the left edge",
                        "is the floor of these laws: refining the spans from", "method = \"decoupled\"",
                        f"at most {number(methods.change.ray_max_arcmin)}′")
    forth, back = " ".join(exchange_sentences(decoupled, other)), " ".join(exchange_sentences(other, decoupled))
    assert not _missing(forth, "Gained (RMS): twist", "Lost (RMS): ky")
    assert not _missing(back, "Gained (RMS): ky", "Lost (RMS): twist", "the lane bends less", "wider upright")
    assert "closer" not in back


def in_percent(stage: StageDeviation, percent: float | None) -> StageDeviation:
    """The same with one value for everything in percent."""
    return replace(stage, **{name: replace(getattr(stage, name), max_percent=percent, rms_percent=percent)
                             for name in (*QUANTITIES, "shape")})


def test_exchange_is_none_where_both_surfaces_hold_the_laws_and_says_where_a_lane_is_missing(
        methods: MethodComparison) -> None:
    held = replace(methods.faithful, deviation=in_percent(methods.faithful.deviation, 1e-7))
    assert exchange_sentences(held, held)[0].startswith("These laws both surfaces hold")
    without = replace(methods.decoupled, lane_straightness_percent=None)
    assert "in the faithful one only" in " ".join(exchange_sentences(without, methods.faithful))
    assert "lane" not in " ".join(exchange_sentences(without, replace(methods.faithful, lane_straightness_percent=None)))


def test_plane_is_the_same_by_both_methods(tmp_path: Path, plane: Designed, methods: MethodComparison) -> None:
    decoupled, other = (replace(one, deviation=in_percent(one.deviation, None), lane_straightness_percent=None)
                        for one in methods.both())
    assert methods.floor is not None
    floor = replace(methods.floor, settled=True, degree=7, levels=(FaithfulLevel((6, 5), 10, 1, None, 0.0),))
    flat = replace(methods, decoupled=decoupled, faithful=other, floor=floor)
    page = _report(tmp_path, plane, replace(METRICS, methods=flat), MANIFEST)
    _check_plain(page)
    assert not _missing(_readable(page), "both methods give the plane itself", "method = \"faithful\"", "glass —",
                        "says nothing of flat glass", "The decoupled surface of a flat design is the plane itself")


def test_laws_that_a_surface_has_are_said_to_be_held() -> None:
    mirror = design(with_method(load_spec("sphere-950"), "faithful"))
    text = model_sentences(_deviation(mirror), "faithful", Floor.found(mirror.faithful), 0.01)
    assert "These laws it holds: refining the spans from" in text
    assert "Codazzi" not in text


@pytest.mark.parametrize(("settled", "levels", "words"), [
    (True, (((6, 5), 1.405), ((8, 6), 1.39975)), "from 1.405\u202f% to 1.400\u202f%, and more of them would gain nothing"),
    (False, (((6, 5), 72.82), ((8, 6), 72.68), ((10, 8), 72.66)), "to 72.66\u202f%, the last step still by 0.020\u202fper"),
    (True, (((5, 4), 1.5),), "the one set of spans asked for (5\u202f×\u202f4 with")])
def test_floor_is_told_by_its_levels(settled: bool, levels: tuple[tuple[tuple[int, int], float], ...], words: str) -> None:
    assert words in str(Floor(7, settled, levels).in_words())
    assert Floor(7, settled, tuple((spans, None) for spans, _ in levels)).in_words() is None


@pytest.mark.parametrize(("kernel", "mesh", "glass", "begins", "holds"), [
    (0.0015, 34.0, 12.6, "The weakest link is the glass, 13 times", "34 times what the eye resolves, more than any other link"),
    (0.0015, 30.0, 37.0, "The weakest link is the glass, 37 times", "30 times what the eye resolves."),
    (19.0, None, 12.0, "The weakest link is the kernel, 19 times", "above it is also the glass; the file stays below it."),
    (0.0015, None, 0.25, "The weakest link is the glass, at 0.25 of", "kernel, file and glass all stay below it."),
    (0.0, 0.0, 0.0, "Neither kernel nor file", "at all.")])
def test_weakest_link_is_named_against_the_eye(kernel: float, mesh: float | None, glass: float, begins: str,
                                               holds: str) -> None:
    chain = RayDeviation(kernel=kernel, file=0.0, mesh=mesh, glass=glass, glass_percent=1.0, eye=1.0)
    text = weakest_sentence(chain)
    assert text.startswith(begins)
    assert holds in text


def test_chain_runs_from_the_kernel_to_the_eye(limited: Designed, faithful: Designed) -> None:
    for (_, deviation), note in ((limited, "at the stated limit of 3\u202f%"),
                                 (faithful, "for each 1\u202f% of curvature, as no limit is stated")):
        links = chain_links(deviation)
        assert [link.name for link in links] == ["kernel", "file", "mesh", "glass", "eye resolves"]
        assert links[3] == Link("glass", f"±{number(deviation.rays.glass)}′", note)
        assert links[-1].value == "1′"


def test_deviations_beyond_their_curvature_are_drawn_per_metre_with_percent_beside(tmp_path: Path) -> None:
    vertical = {"law": "expression", "curvature": "0.0008*cos(3*t)"}
    mirror = design(validate_spec({"name": "turning", "horizontal": TURNING, "vertical": vertical,
                                   "limits": {"curvature_percent": 5.0}}))
    deviation = _deviation(mirror)
    drawn = fields.deviation_fields(deviation, 5.0)
    assert (drawn.unit, drawn.limit) == ("1/m", None)
    assert drawn.worst["k2"][0] == pytest.approx(deviation.total.k2.max_per_m, rel=1e-12)
    page = _report(tmp_path, (mirror, deviation), Metrics(), Manifest())
    _check_plain(page)
    assert not _missing(_readable(page), "Beyond the limit of ±5\u202f%", "of the area lies beyond", "is not drawn",
                        "the figures per metre hold", f"{number(deviation.total.k2.max_percent)}\u202f%",
                        f"k2 {number(deviation.total.k2.max_per_m)}\u202f/m at x")


def test_designed_and_realised_share_a_scale_and_deviations_one_about_zero(limited: Designed, plane: Designed) -> None:
    for _, deviation in (limited, plane):
        for pair in fields.pairs_of(deviation):
            low, high = pair.scale()
            assert low <= min(pair.designed.min(), pair.realised.min()) < high
            assert low < max(pair.designed.max(), pair.realised.max()) <= high
    near, far = (fields.deviation_fields(limited[1], limit) for limit in (3.0, 30.0))
    largest = max(abs(limited[1].total.of(key).max_percent) for key in QUANTITIES)
    assert near.scale == far.scale == largest
    assert far.limit_is_far > near.limit_is_far
    for key, (value, at) in near.worst.items():
        assert (value, at) == (limited[1].total.of(key).max_percent, limited[1].total.of(key).max_at_mm)


def test_radius_is_drawn_as_curvature_only_where_it_has_to_be() -> None:
    concave = {"law": "constant", "radius_mm": -2000.0}
    mirror = design(validate_spec({"name": "turning", "horizontal": TURNING, "vertical": concave}))
    horizontal, vertical = fields.pairs_of(_deviation(mirror))[:2]
    assert (horizontal.name, horizontal.unit, horizontal.as_curvature) == ("1/Rx", "1/m", True)
    assert (vertical.name, vertical.unit, vertical.as_curvature) == ("Ry", "mm", False)
    assert np.allclose(vertical.designed, -2000.0)


def test_index_lists_every_mirror_and_the_papers_figures(
        tmp_path: Path, limited: Designed, methods: MethodComparison) -> None:
    names = ["sphere-1250", "sphere-1050", "sphere-950", "progressive-a", "progressive-b", "progressive-c"]
    mirrors = [Built(design(load_spec(name)), limited[1], METRICS, ()) for name in names]
    table1 = {name: PaperRow(Compared(44.82, 44.8), Compared(42.875, 42.9), Compared(None, 40.7)) for name in names[3:]}
    write_index(tmp_path / "index.html", mirrors, table1, {"fig5": "fig5.png", "fig6": "fig6.png"})
    page = (tmp_path / "index.html").read_text("utf-8")
    assert not re.search(r"https?://|<script|\b(nan|None|null)\b", page)
    for name in names:
        assert not _missing(page, *(f'href="{name}/{file}"' for file in
                                    ("report.html", f"{name}.step", "driver-view.png")))
    assert not _missing(page, 'src="fig5.png"', 'src="fig6.png"', ">44.82<", ">44.8<", ">+0.02<", ">40.7<",
                        "Y = 2400 + 0.6·X", "is not public", "950 mm", "1250 → 400 mm, zones")
    assert "shape RMS" not in page
    decoupled, other = (replace(one, deviation=in_percent(one.deviation, percent))
                        for one, percent in zip(methods.both(), (2.3251, 1.0093), strict=True))
    measured = replace(METRICS, methods=replace(methods, decoupled=decoupled, faithful=other))
    mirrors[-1] = replace(mirrors[-1], metrics=measured)
    write_index(tmp_path / "index.html", mirrors, table1, {})
    page = (tmp_path / "index.html").read_text("utf-8")
    assert not _missing(page, "shape RMS<br>decoupled<br>faithful", "2.33\u202f%<br>1.01\u202f%", "—<br>—")
    assert not _missing(table1_markdown(table1), "| 44.82 | 44.8 | +0.02 |", "| — | 40.7 | — |")


def test_contact_sheet_puts_pictures_side_by_side(tmp_path: Path) -> None:
    red, blue = Image.new("RGB", (64, 88), "red"), Image.new("RGB", (64, 88), "blue")
    red.save(tmp_path / "red.png")
    contact_sheet(tmp_path / "sheet.png", "Two", [("(a) a caption long enough to need a second line " * 3,
                                                   tmp_path / "red.png"), ("(b)", blue)])
    with Image.open(tmp_path / "sheet.png") as sheet:
        assert sheet.width == 1800
        assert [sheet.getpixel(at) for at in ((2, 2), (450, 600), (1350, 600))] == [
            (255, 255, 255), (255, 0, 0), (0, 0, 255)]


@pytest.mark.parametrize(("value", "digits", "text"), [
    (4.9e-8, 3, "4.9·10⁻⁸"), (-4.6419, 3, "−4.64"), (0.0, 3, "0"), (9.9999, 3, "10.0"), (None, 3, "—"),
    (68985.27, 5, "68\u202f985"), (math.nan, 3, "—"), (9.96e-8, 3, "1.0·10⁻⁷"), (0.00123, 3, "0.00123"),
    (-math.inf, 3, "−∞"), (1250.0, 3, "1250")])
def test_numbers_as_text(value: float | None, digits: int, text: str) -> None:
    assert number(value, digits) == text


def test_asked_values_keep_their_digits_and_laws_read_as_sentences() -> None:
    assert [given(1e-5, "mm"), given(0.01, "%"), given(2.5e-6, "mm")] == [
        "10⁻⁵\u202fmm", "0.01\u202f%", "2.5·10⁻⁶\u202fmm"]
    assert [fixed(-0.001, 2, sign=True), fixed(0.017, 2, sign=True)] == ["0.00", "+0.02"]
    constants = laws.Constant(radius_mm=math.inf), laws.Constant(radius_mm=-2000)
    assert [law.in_words() for law in constants] == ["flat", "−2000 mm (concave)"]
