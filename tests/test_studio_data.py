"""Mirrors that no law of the studio's page makes: measured ones, those of a study's front, and from a view drawn by hand."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect

from mirror_cad.errors import FileError, SpecError
from mirror_cad.spec.file import load_spec, spec_as_json
from mirror_studio import cli
from mirror_studio.explore.evaluate import evaluate
from mirror_studio.explore.front import front_of
from mirror_studio.web import engine
from mirror_studio.web.state import as_spec, as_state
from mirror_studio.web.uploads import Uploads
from mirror_studio.web.view_grid import COLUMNS, DIGITS, ROWS, view_grid
from tests.conftest import designed
from tests.studio_page import (
    CHROMIUM,
    SOON,
    becomes,
    chromium,
    figure,
    key,
    opened,
    revision,
    revision_after,
    settled,
)
from tests.studio_server import Studio, running

STEP_MM, SIGMA_MM, DENT_MM = 10.0, 0.002, 0.1

pytestmark = pytest.mark.skipif(not CHROMIUM.exists(), reason=f"no Chromium at {CHROMIUM}: the page cannot be opened")


MEASURES = ("lane_straightness_percent", "v_fov_left_traced_deg", "h_fov_traced_deg")
VARIED = {"vary": {"vertical.right_mm": [1250.0, 1000.0, 900.0, 760.0], "vertical.left_mm": [1350.0, 1010.5, 871.25, 722.125]}}


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The directory of an optimisation, with figures that its designs really have."""
    folder = tmp_path_factory.mktemp("studies") / "taller"
    folder.mkdir()
    raw = spec_as_json(load_spec("progressive-c"))
    keys, rows = list(VARIED["vary"]), []
    for values in zip(*VARIED["vary"].values(), strict=True):
        changed = {"vertical": {"law": "linear", "right_mm": values[0], "left_mm": values[1]}}
        figures = evaluate(len(rows), values, raw | changed, ".", None, MEASURES).figures
        rows.append(",".join(map(repr, [*values, *figures])) + ",ok,,1e-9")
    (folder / "front.csv").write_text("\n".join([",".join([*keys, *MEASURES, "status,cause,step_apart"]), *rows]) + "\n")
    (folder / "optimise.json").write_text(json.dumps({"minimise": [MEASURES[0]], "maximise": [MEASURES[1]], "scene": None,
                                                      "spec": raw}))
    return folder


@pytest.fixture(scope="module")
def studio(study: Path) -> Iterator[Studio]:
    with running(0, "--study", str(study)) as one:
        yield one


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as one:
        yield one


@pytest.fixture
def page(browser: Browser, studio: Studio) -> Iterator[Page]:
    with opened(browser, studio) as one:
        yield one


def points_of_a_made_mirror() -> str:
    """progressive-c with a dent and noise, in another pose, as CSV in mm."""
    mirror, rng = designed("progressive-c"), np.random.default_rng(4)
    x, y = (v.ravel() for v in np.meshgrid(np.arange(-115.0, 116.0, STEP_MM), np.arange(-165.0, 166.0, STEP_MM)))
    inside = mirror.outline.contains(x, y)
    x, y = x[inside], y[inside]
    z = mirror.surface.heights(x, y)[0] + rng.normal(0.0, SIGMA_MM, x.size)
    z += DENT_MM * np.exp(-((x + 40.0) ** 2 + (y - 50.0) ** 2) / (2.0 * 35.0**2))
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    points = np.stack([x, y, z], axis=1) @ turn.T + [20.0, -10.0, 300.0]
    return "x_mm,y_mm,z_mm\n" + "\n".join(",".join(f"{value:.6f}" for value in row) for row in points) + "\n"


def drop(page: Page, name: str, text: str, zone: str) -> None:
    """Drop a file on one of the page's zones, as a hand does with a file manager."""
    data = page.evaluate_handle("""([name, text]) => { const data = new DataTransfer();
        data.items.add(new File([text], name)); return data; }""", [name, text])
    page.dispatch_event("body", "dragenter", {"dataTransfer": data})
    expect(page.locator("#drop")).to_be_visible()
    page.dispatch_event(f'[data-zone="{zone}"]', "drop", {"dataTransfer": data})
    expect(page.locator("#drop")).to_be_hidden()


# --- the front of a study ---------------------------------------------------------------------------------------------


def test_dragging_along_the_front_of_a_study_shows_its_designs(page: Page, study: Path, tmp_path: Path) -> None:
    """Pictures come while the hand drags; the design that it stops at is the page's, with the figures of the study's row."""
    settled(page)
    plot = page.get_by_test_id("front-plot")
    expect(plot).to_be_visible()
    box = plot.bounding_box()
    assert box
    rows = list(csv.DictReader((study / "front.csv").open()))
    before, seen, moves = revision(page), 0, 0
    page.mouse.move(box["x"] + 60, box["y"] + box["height"] - 40)
    page.mouse.down()
    while moves < 12 or seen < 2:
        moves += 1
        assert moves < 500
        share = min(moves, 12) / 12
        across = 0.5 if moves % 2 else 0.9
        page.mouse.move(box["x"] + across * box["width"], box["y"] + (1.0 - share) * box["height"] + 10)
        page.wait_for_timeout(60)
        if revision(page) > before:
            seen, before = seen + 1, revision(page)
    page.mouse.up()
    settled(page)
    last = next(row for row in rows if float(row["vertical.left_mm"]) == key(page, "vertical.left_mm"))
    for name, of in (("straightness", MEASURES[0]), ("v-fov-traced", MEASURES[1]), ("h-fov-traced", MEASURES[2])):
        assert figure(page, name) == pytest.approx(float(last[of]), rel=1e-9)
    plot.press("ArrowLeft")
    plot.press("ArrowLeft")
    plot.press("ArrowLeft")
    becomes(page, "vertical.left_mm", float(sorted(rows, key=lambda row: float(row[MEASURES[0]]))[0]["vertical.left_mm"]))
    with page.expect_download(timeout=SOON) as download:
        page.click('[data-take="spec"]')
    download.value.save_as(tmp_path / "chosen.toml")
    assert load_spec(tmp_path / "chosen.toml").vertical == load_spec("progressive-c").vertical.model_copy(
        update={"right_mm": key(page, "vertical.right_mm"), "left_mm": key(page, "vertical.left_mm")})
    drop(page, "front.csv", "vertical.left_mm,status,cause\n", "measured")
    expect(page.get_by_test_id("error")).to_have_text("front.csv: no front of a study: it has no column of a measure")
    drop(page, "front.csv", "vertical.left_mm,radius_mm,status,cause\n1200,3,ok,\n1300,2,ok,\n", "open")
    expect(page.get_by_test_id("front")).to_contain_text("2 designs, varied from the design that was on the page")


@pytest.mark.parametrize(("table", "summary", "words"), [
    ("x_mm,y_mm\n1,2\n", None, "no front of a study"),
    ("vertical.left_mm,status,cause\n", None, "no column of a measure"),
    ("h_fov_traced_deg,status,cause\n", None, "no column of a key"),
    ("vertical.left_mm,h_fov_traced_deg,status,cause\n1200,,failed,steep\n", None, "the front is empty"),
    ("vertical.left_mm,h_fov_traced_deg,status,cause\n1200,44,ok\n", None, "line 2 has 3 fields, and the first one 4"),
    ("vertical.left_mm,h_fov_traced_deg,status,cause\n1200,wide,ok,\n", None, "h_fov_traced_deg = 'wide' is no number"),
    ("vertical.left_mm,h_fov_traced_deg,status,cause\n1200,44,ok,\n", "[1]", "is none that `mirror-cad optimise` wrote"),
    ("vertical.left_mm,h_fov_traced_deg,status,cause\n1200,44,ok,\n", '{"minimise": ["length"]}', "is of another study"),
])
def test_a_table_that_is_no_front_says_why(table: str, summary: str | None, words: str) -> None:
    with pytest.raises(FileError, match=re.escape(words)):
        front_of("front.csv", table, summary)


def test_a_studio_of_a_study_without_a_front_does_not_start(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["studio", "--no-browser", "--port", "0", "--study", str(tmp_path)]) == cli.BAD_INPUT
    assert f"{tmp_path}: holds no front.csv" in capsys.readouterr().err


# --- a view drawn by hand ---------------------------------------------------------------------------------------------


def test_the_grid_of_a_sphere_is_what_a_sphere_reflects() -> None:
    """The law of reflection at where the eye's ray through (x, y, 0) meets the sphere, to the grid's last digit."""
    one = engine.designed(load_spec("sphere-950"))
    grid, radius, eye = view_grid(one), 950.0, one.setup.eye
    x, y = np.meshgrid(grid["x_mm"], grid["y_mm"])
    ray = np.stack([x, y, np.zeros_like(x)], axis=-1) - eye
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    centre = np.array([0.0, 0.0, -radius])
    along = -(ray @ (eye - centre))
    points = eye + (along - np.sqrt(along**2 - (eye - centre) @ (eye - centre) + radius**2))[..., None] * ray
    normal = (points - centre) / radius
    out = ray - 2.0 * (ray * normal).sum(axis=-1, keepdims=True) * normal
    for k, key_ in enumerate(("azimuth_deg", "elevation_deg")):
        assert np.degrees(np.arctan(out[..., k] / out[..., 2])) == pytest.approx(np.array(grid[key_]), abs=0.51 * 10.0**-DIGITS)


def test_no_file_of_a_target_is_read_by_its_name(tmp_path: Path) -> None:
    spec = load_spec("perspective")
    uploads = Uploads()
    try:
        for section in ({"projection": "table", "file": "/etc/hostname"},
                        spec.target.model_dump(exclude_none=True) | {"weight": {"file": "w.csv"}}):  # type: ignore[union-attr]
            with pytest.raises(SpecError, match=r"the studio reads no files by their names"):
                as_spec(as_state(spec) | {"target": section}, uploads)
    finally:
        uploads.close()


def test_a_node_dragged_on_the_picture_changes_what_is_seen_there(page: Page, tmp_path: Path) -> None:
    settled(page)
    h_fov = figure(page, "h-fov-traced")
    page.click("#wanted-view > summary")
    page.click("#draw-grid")
    becomes_view = "document.querySelector('#wanted-view').textContent.includes('the laws have no effect')"
    page.wait_for_function(becomes_view, timeout=SOON)
    settled(page)
    assert figure(page, "h-fov-traced") == pytest.approx(h_fov, abs=0.1)  # the grid begins as what the mirror shows
    box = page.locator("#driver-view").bounding_box()
    assert box
    middle = box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]  # a node: the grid's numbers are odd
    before = revision(page)
    page.mouse.move(*middle)
    page.mouse.down()
    page.mouse.move(middle[0] + 12, middle[1], steps=3)
    expect(page.locator("#readout")).to_contain_text("To be seen here")
    revision_after(page, before)  # while it is held
    page.mouse.up()
    settled(page)
    with page.expect_download(timeout=SOON) as download:
        page.click('[data-take="spec"]')
    download.value.save_as(tmp_path / "drawn.toml")
    spec = load_spec(tmp_path / "drawn.toml")
    target, first = spec.target, view_grid(engine.designed(load_spec("progressive-c")))
    assert target is not None
    assert target.projection == "table"
    k = COLUMNS // 2
    asked, was = target.azimuth_deg[ROWS // 2][k], first["azimuth_deg"][ROWS // 2][k]  # type: ignore[index]
    assert asked > was + 0.5  # more to the right than before
    now = view_grid(engine.designed(spec))["azimuth_deg"][ROWS // 2][k]  # type: ignore[index]
    assert abs(now - asked) < 0.2 * (asked - was)  # for the most: its neighbours follow without curl
    page.get_by_text("The laws again").click()
    settled(page)
    assert figure(page, "h-fov-traced") == pytest.approx(h_fov, abs=1e-9)
    page.select_option("#preset", "perspective")
    page.wait_for_function("document.querySelector('[data-testid=straightness]').textContent === '−0.27'", timeout=SOON)


# --- a made mirror ----------------------------------------------------------------------------------------------------


def test_measured_points_dropped_on_the_page_are_laid_on_its_design(page: Page, tmp_path: Path) -> None:
    """The panel has inspection.json's figures, the map its deviations, and the measured mirror is seen beside the design."""
    settled(page)
    error, panel = page.get_by_test_id("error"), page.get_by_test_id("measured")
    drop(page, "nothing.csv", "x_mm,y_mm,z_mm\n1,2,3\n2,3,4\n", "measured")
    expect(error).to_have_text("nothing.csv: 2 points tell no mirror: at least 6 are needed", timeout=2 * SOON)
    expect(panel).to_be_hidden()
    before = revision(page)
    drop(page, "glass 7.csv", points_of_a_made_mirror(), "measured")
    expect(error).to_be_hidden()
    expect(page.get_by_test_id("measured-figures")).to_be_visible(timeout=3 * SOON)
    revision_after(page, before)  # the measured mirror beside the design
    settled(page)
    page.wait_for_function("location.hash.includes('look.own=')", timeout=SOON)
    with page.expect_download() as download:
        page.get_by_test_id("measured-inspection").click()
    download.value.save_as(tmp_path / "inspection.json")
    of_page = json.loads((tmp_path / "inspection.json").read_text())
    row = panel.locator('tr[data-quantity="height"] td').first
    expect(row).to_contain_text(f"{1000.0 * of_page['height']['max_mm']:.1f} ± ".replace("-", "−"))
    for name in ("h_fov_traced_deg", "lane_straightness_percent"):
        measured = of_page["driver"]["measures"][name]["measured"]
        expect(panel.locator(f'tr[data-measure="{name}"]')).to_contain_text(f"{measured:.1f}")
    # The map has the dent where it is, and says its height under the pointer.
    page.select_option("#quantity", "measured_height_mm")
    box = page.locator("#flat-map").bounding_box()
    assert box
    scale = min((box["width"] - 8) / 230, (box["height"] - 8) / (2 * designed("progressive-c").box[3]))
    page.mouse.move(box["x"] + box["width"] / 2 - 40 * scale, box["y"] + box["height"] / 2 - 50 * scale)
    caption = page.locator("#map-caption").inner_text()
    assert 70.0 < float(caption.split(" ± ")[0]) < 105.0, caption  # µm; the best fit takes some of the dent for a motion
    # Another design: what was found is of the one before.
    page.get_by_label("Ry left in mm").fill("1340")
    expect(panel.get_by_text("Compare again")).to_be_visible()
    panel.get_by_label("Put the measured mirror away").click()
    expect(panel).to_be_hidden()
    settled(page)
    page.wait_for_function("!location.hash.includes('look.own=')", timeout=SOON)
