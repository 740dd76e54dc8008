"""Data of others on the studio's page: measured points laid on its design."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect

from tests.conftest import designed
from tests.studio_page import CHROMIUM, SOON, chromium, opened, revision, revision_after, settled
from tests.studio_server import Studio, running

STEP_MM, SIGMA_MM, DENT_MM = 10.0, 0.002, 0.1

pytestmark = pytest.mark.skipif(not CHROMIUM.exists(), reason=f"no Chromium at {CHROMIUM}: the page cannot be opened")


@pytest.fixture(scope="module")
def studio() -> Iterator[Studio]:
    with running() as one:
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
    assert "look.own=" in page.url
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
