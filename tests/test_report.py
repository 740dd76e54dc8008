"""Designed mirrors in, what their report and the paper's index must and must not hold out."""

from __future__ import annotations

import io
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from mirror_cad.deviation import CurvatureDeviation
from mirror_cad.mesh import SurfaceMesh
from mirror_cad.mirror import Mirror, design
from mirror_cad.spec_file import load_spec, validate_spec
from mirror_studio.report import contact_sheet, maps, table1_markdown, write_index, write_report
from mirror_studio.report.text import fixed, given, law_in_words, number

METRICS = {
    "h_fov_deg": {"section": 44.82, "traced": 44.63}, "v_fov_left_deg": {"section": 42.88, "traced": 39.6},
    "lane_straightness_percent": {"traced": 40.91, "image": None},
    "stl_on_plane_mm": {"max": 310.0, "rms": 95.0, "rays": 12345}, "rays": {"reflected": 15_000_000, "missed": 10},
    "eye_mm": [115.0, 0.0, 753.27], "plate": {"area_mm2": 68985.3, "volume_mm3": None},
    "files": {"step_max_mm": 3e-11},
}
MANIFEST = {"schema": 1, "versions": {"mirror-cad": "0.1.0"}, "notes": ["read <b>a&b</b>"],
            "files": {"mirror.step": "ab" * 32}}
Designed = tuple[Mirror, CurvatureDeviation]
FLAT = {"law": "constant", "radius_mm": math.inf}


def _picture() -> bytes:
    file = io.BytesIO()
    Image.new("RGB", (64, 88), "grey").save(file, "PNG")
    return file.getvalue()


def _deviation(mirror: Mirror) -> CurvatureDeviation:
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


def _report(folder: Path, designed: Designed, metrics: dict[str, Any], manifest: dict[str, Any]) -> str:
    write_report(folder / "report.html", *designed, metrics, manifest, _picture())
    return (folder / "report.html").read_text("utf-8")


def _readable(page: str) -> str:
    """What a reader meets: the page without its pictures and style."""
    return re.sub(r"data:[a-z/+]+;base64,[A-Za-z0-9+/=]+|<style>.*?</style>", "", page, flags=re.DOTALL)


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
    assert page.count("data:image/") == 6
    assert len(page) < 2.5e6
    assert not _missing(text, "Tolerances met", "Beyond the limit of ±3\u202f%", "of the area lies beyond",
                        "No numerics can remove this", "44.82°", "39.60°", "40.9\u202f%", "68\u202f985\u202fmm²",
                        "3.0·10⁻¹¹\u202fmm", "ab" * 32, "0.5865 (solved for)", "read &lt;b&gt;a&amp;b&lt;/b&gt;")


def test_report_of_a_plane_without_measurements(tmp_path: Path, plane: Designed) -> None:
    page = _report(tmp_path, plane, {}, {})
    _check_plain(page)
    assert not _missing(page, "The design is flat", "Rx and Ry are flat", "No limit asked for")


def test_designed_and_realised_share_a_scale_and_deviations_one_about_zero(limited: Designed, plane: Designed) -> None:
    for _, deviation in (limited, plane):
        for pair in maps.pairs_of(deviation):
            low, high = pair.scale()
            assert low <= min(pair.designed.min(), pair.realised.min()) < high
            assert low < max(pair.designed.max(), pair.realised.max()) <= high
    near, far = (maps.deviation_fields(limited[1], limit) for limit in (3.0, 30.0))
    largest = max(abs(limited[1].total[f"{key}_max_percent"]) for key in maps.QUANTITIES)
    assert near.scale == far.scale == largest
    assert far.limit_is_far > near.limit_is_far


def test_radius_is_drawn_as_curvature_only_where_it_has_to_be() -> None:
    concave = {"law": "constant", "radius_mm": -2000.0}
    turning = {"law": "expression", "curvature": "0.001*(t - 0.4)"}
    mirror = design(validate_spec({"name": "turning", "horizontal": turning, "vertical": concave}))
    horizontal, vertical = maps.pairs_of(_deviation(mirror))[:2]
    assert (horizontal.name, horizontal.unit, horizontal.as_curvature) == ("1/Rx", "1/m", True)
    assert (vertical.name, vertical.unit, vertical.as_curvature) == ("Ry", "mm", False)
    assert np.allclose(vertical.designed, -2000.0)


def test_index_lists_every_mirror_and_the_papers_figures(tmp_path: Path, limited: Designed) -> None:
    names = ["sphere-1250", "sphere-1050", "sphere-950", "progressive-a", "progressive-b", "progressive-c"]
    deviation = limited[1].as_json()
    mirrors = [{"name": name, "metrics": METRICS, "deviation": deviation, "spec": load_spec(name).model_dump()}
               for name in names]
    table1 = {name: {"h_fov_deg": {"ours": 44.82, "paper": 44.8}, "v_fov_left_deg": {"ours": 42.875, "paper": 42.9},
                     "lane_straightness_percent": {"ours": None, "paper": 40.7}} for name in names[3:]}
    write_index(tmp_path / "index.html", mirrors, table1, {"fig5": "fig5.png", "fig6": "fig6.png"})
    page = (tmp_path / "index.html").read_text("utf-8")
    assert not re.search(r"https?://|<script|\b(nan|None|null)\b", page)
    for name in names:
        assert not _missing(page, *(f'href="{name}/{file}"' for file in
                                    ("report.html", f"{name}.step", "driver-view.png")))
    assert not _missing(page, 'src="fig5.png"', 'src="fig6.png"', ">44.82<", ">44.8<", ">+0.02<", ">40.7<",
                        "Y = 2400 + 0.6·X", "is not public")
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
    assert [law_in_words(FLAT), law_in_words(FLAT | {"radius_mm": -2000.0})] == ["flat", "−2000 mm (concave)"]
