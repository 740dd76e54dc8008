"""A study's page in Chromium: what is brushed is what the numbers say, and a design opens in the studio."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pytest

from mirror_studio.explore.evaluate import Row
from mirror_studio.explore.page import write_page
from mirror_studio.explore.study import Study, load_study

pytest.importorskip("playwright")
from playwright.sync_api import Browser, Page

from tests.studio_page import CHROMIUM, chromium

pytestmark = pytest.mark.skipif(not CHROMIUM.exists(), reason=f"no Chromium at {CHROMIUM}: the page cannot be opened")

STUDY = """
spec = "perspective"
samples = 4
measures = ["h_fov_traced_deg", "v_fov_left_traced_deg", "lane_straightness_percent"]
[vary]
"target.azimuth_deg.0" = { from = -40.0, to = -30.0 }
"eye.distance_mm" = { from = 700.0, to = 800.0 }
"eye.aligned" = { values = ["left", "right"] }
"""
CAUSE = 'no </script> sheet & "no" mirror'


def study(folder: Path) -> Study:
    (folder / "s.toml").write_text(STUDY, encoding="utf-8")
    return load_study(folder / "s.toml")


def designs(n: int) -> list[Row]:
    rng = np.random.default_rng(1)
    at, figures = rng.uniform(size=(n, 2)), rng.uniform(size=(n, 3))
    return [Row(k, (-40.0 + 10.0 * a, 700.0 + 100.0 * b, ("left", "right")[k % 2]),
                (None, None, None) if k % 10 == 3 else tuple(figures[k].tolist()), "failed" if k % 10 == 3 else "ok",
                CAUSE if k % 10 == 3 else "") for k, (a, b) in enumerate(at)]


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as one:
        yield one


def shown(browser: Browser, path: Path, wrong: list[str]) -> Page:
    page = browser.new_page(viewport={"width": 1300, "height": 900})
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("request", lambda request: None if request.url.startswith("file:") else wrong.append(request.url))
    page.goto(f"file://{path}")
    page.wait_for_function("document.body.dataset.ready")
    return page


def drag(page: Page, start: tuple[float, float], stop: tuple[float, float]) -> None:
    page.mouse.move(*start)
    page.mouse.down()
    page.mouse.move(*stop, steps=3)
    page.mouse.up()
    page.wait_for_function("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(true))))")


def test_a_brush_keeps_what_lies_in_it_and_a_design_opens(tmp_path: Path, browser: Browser) -> None:
    rows, wrong = designs(300), []
    write_page(tmp_path / "study.html", study(tmp_path), rows, rows[:3], [(100, 0.5), (300, 0.7)], "hypervolume", "words & <b>")
    page = shown(browser, tmp_path / "study.html", wrong)
    assert page.inner_text("#count") == "all 300 designs"
    assert "words & <b>" in page.inner_text("body")
    # Along the axis of the first figure, the fourth of the columns that are shown.
    box, at = page.locator("#lines").bounding_box(), page.evaluate("[axisX(3), axisY(0.25), axisY(0.75)]")
    assert box is not None
    drag(page, (box["x"] + at[0], box["y"] + at[1]), (box["x"] + at[0], box["y"] + at[2]))
    low, high = page.evaluate("columns[3].brush")
    assert low == pytest.approx(0.25, abs=0.01)
    values = np.array([np.nan if row.figures[0] is None else row.figures[0] for row in rows])
    share = (values - np.nanmin(values)) / (np.nanmax(values) - np.nanmin(values))
    kept = (share >= low) & (share <= high)
    assert int(page.evaluate("document.body.dataset.chosen")) == kept.sum()
    panel = page.locator("#matrix canvas").first.bounding_box()
    assert panel is not None
    drag(page, (panel["x"] + 20, panel["y"] + 20), (panel["x"] + 150, panel["y"] + 120))
    x0, x1, y0, y1 = page.evaluate("[...boxes.values()][0]")
    second = np.array([np.nan if row.figures[1] is None else row.figures[1] for row in rows])
    upright = (second - np.nanmin(second)) / (np.nanmax(second) - np.nanmin(second))
    kept &= (share >= x0) & (share <= x1) & (upright >= y0) & (upright <= y1)
    assert int(page.evaluate("document.body.dataset.chosen")) == kept.sum() > 0
    page.locator("#list-rows .row").first.click()
    opened = rows[int(page.evaluate("document.body.dataset.opened"))]
    assert kept[opened.index]
    address = unquote(page.get_attribute("#design-open", "href") or "")
    assert address.startswith("http://127.0.0.1:8642/#perspective&")
    first = re.search(r"target\.azimuth_deg=\[([-\d.]+),10\.4\]", address)
    assert first is not None
    assert float(first[1]) == opened.values[0]
    assert f"eye.aligned={opened.values[2]}" in address
    page.locator("#clear").click()
    page.locator("#only-front").check()
    page.wait_for_function("document.body.dataset.chosen === '3'")
    assert wrong == []


def test_causes_of_failed_designs_are_told_as_they_are(tmp_path: Path, browser: Browser) -> None:
    wrong: list[str] = []
    write_page(tmp_path / "study.html", study(tmp_path), designs(20))
    page = shown(browser, tmp_path / "study.html", wrong)
    page.locator("#list-rows .row").nth(3).click()
    assert CAUSE in page.inner_text("#design-figures")
    assert wrong == []


@pytest.mark.long
def test_a_hundred_thousand_designs_are_there_in_three_seconds(tmp_path: Path, browser: Browser) -> None:
    """By the browser's own clock; and a brush is drawn in less than a fifth of a second on a machine that does other work."""
    wrong: list[str] = []
    write_page(tmp_path / "study.html", study(tmp_path), designs(100_000))
    began = time.monotonic()
    page = shown(browser, tmp_path / "study.html", wrong)
    assert time.monotonic() - began < 12.0
    assert float(page.evaluate("document.body.dataset.ready")) < 3000.0
    box, at = page.locator("#lines").bounding_box(), page.evaluate("[axisX(3), axisY(0.9), axisY(0.1)]")
    assert box is not None
    frames = []
    page.mouse.move(box["x"] + at[0], box["y"] + at[1])
    page.mouse.down()
    for share in np.linspace(0.1, 1.0, 10):
        page.mouse.move(box["x"] + at[0], box["y"] + at[1] + share * (at[2] - at[1]))
        page.wait_for_function("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(true))))")
        frames.append(float(page.evaluate("document.body.dataset.frame")))
    page.mouse.up()
    assert np.median(frames) < 200.0
    assert wrong == []
