"""The report as PDF: its pages as they would be printed, and what is said where none can be made."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pypdfium2
import pytest

from mirror_cad.design_stages import design
from mirror_cad.spec.file import load_spec, validate_spec
from mirror_studio.report.page import write_report
from mirror_studio.report.pdf import write_pdf
from mirror_studio.report.report_data import find
from tests.conftest import designed
from tests.test_findings import deviation_of
from tests.test_report import MANIFEST, METRICS, _picture

A4 = (595.28, 841.89)  # points
HEADINGS = ("Verdicts", "Basis", "What the driver sees", "Designed and realised curvature", "Deviation over the mirror",
            "Sections", "Stage by stage", "Before and after STEP", "Probe points", "How it was made")


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pdf")
    mirror = designed("progressive-c")
    deviation = deviation_of(mirror)
    before = os.environ.get("SOURCE_DATE_EPOCH")
    os.environ["SOURCE_DATE_EPOCH"] = "1400000000"
    try:
        write_report(folder / "report.html", mirror, deviation, METRICS, MANIFEST, _picture(),
                     find(mirror, deviation, mirror.surface, METRICS))
        for name in ("report.pdf", "again.pdf"):
            write_pdf(folder / "report.html", folder / name)
    finally:
        os.environ.pop("SOURCE_DATE_EPOCH")
        if before is not None:
            os.environ["SOURCE_DATE_EPOCH"] = before
    return folder


def test_pages_are_a4_numbered_and_named_and_hold_every_section(report: Path) -> None:
    with pypdfium2.PdfDocument(report / "report.pdf") as document:
        assert 6 <= len(document) <= 14
        texts = []
        for number in range(len(document)):
            page = document[number]
            assert page.get_size() == pytest.approx(A4, abs=1.0)
            texts.append(page.get_textpage().get_text_range())
            assert f"page {number + 1} of {len(document)}" in texts[-1]
            assert "progressive-c, left hand" in texts[-1]
    whole = "\n".join(texts)
    for heading in HEADINGS:
        assert heading in whole, heading
    # One page to sign: who, what and the verdict before it.
    for words in ("made", "checked", "approved", "signature", "Part number", "Tolerances met"):
        assert words in texts[0], words
    # The stage table and the probe table lie on one page each, heads with them.
    (stages,) = (text for text in texts if "Stage by stage" in text)
    assert all(name in stages for name in ("model", "integration", "fit", "STEP", "total"))
    (points,) = (text for text in texts if "Probe points" in text)
    assert "direction of R1" in points
    assert all(f"{z:.6f}" in points for z in (8.243264, 9.908646))


def test_figures_are_drawn_inside_the_margins_and_no_page_is_empty(report: Path) -> None:
    coloured = 0
    with pypdfium2.PdfDocument(report / "report.pdf") as document:
        for number in range(len(document)):
            picture = document[number].render(scale=1.0).to_numpy().astype(int)
            inked = (np.abs(picture - 255).max(axis=2) > 24)
            assert inked.mean() > 0.01
            rows, columns = np.nonzero(inked)
            # 14 mm beside and 8 mm to the running lines above and below, in points of 1/72 inch.
            assert columns.min() >= 36
            assert columns.max() <= picture.shape[1] - 36
            assert rows.min() >= 20
            assert rows.max() <= picture.shape[0] - 20
            coloured += int((np.ptp(picture, axis=2) > 60).sum() > 2000)
    assert coloured >= 3  # driver's view or maps, deviation, sections


def test_the_longest_names_stay_on_the_page_and_are_signed_beside_what_they_name(tmp_path: Path) -> None:
    name, part = "N" * 64, {"number": "W" * 48, "revision": "X" * 48, "title": "M" * 100}
    raw = load_spec("sphere-950").model_dump(exclude_none=True, exclude={"outline"})
    mirror = design(validate_spec(raw | {"name": name, "part": part, "limits": {"h_fov_deg": [44.0, 46.0]}}))
    deviation = deviation_of(mirror)
    files = {f"{name}{end}": "cd" * 32 for end in (".step", "-surface.step", ".stl", "-points.csv")}
    manifest = replace(MANIFEST, files=files)
    write_report(tmp_path / "report.html", mirror, deviation, METRICS, manifest, _picture(),
                 find(mirror, deviation, mirror.surface, METRICS))
    write_pdf(tmp_path / "report.html", tmp_path / "report.pdf")
    with pypdfium2.PdfDocument(tmp_path / "report.pdf") as document:
        texts = [page.get_textpage().get_text_range() for page in document]
        (signed,) = (text for text in texts if "approved" in text)
        assert "what is signed" in signed
        for page in document:
            inked = np.abs(page.render(scale=1.0).to_numpy().astype(int) - 255).max(axis=2) > 24
            columns = np.nonzero(inked)[1]
            assert columns.min() >= 36
            assert columns.max() <= inked.shape[1] - 36


def test_the_same_report_gives_the_same_bytes(report: Path) -> None:
    assert (report / "report.pdf").read_bytes() == (report / "again.pdf").read_bytes()


@pytest.mark.parametrize(("module", "words"), [
    ("raise ImportError('No module named weasyprint')", "mirror-cad[pdf]"),
    ("raise OSError(\"cannot load library 'libpango-1.0-0': error 0x7e.\")", "libpango-1.0-0")])
def test_where_no_pdf_can_be_made_it_says_so_before_anything_is_built(module: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "lacking").mkdir()
    (tmp_path / "lacking" / "weasyprint.py").write_text(module)
    before = os.environ.get("PYTHONPATH")
    path = os.pathsep.join([str(tmp_path / "lacking"), *([before] if before else [])])
    result = subprocess.run([sys.executable, "-m", "mirror_studio", "build", "progressive-c", "--pdf", "--out",
                             str(tmp_path / "set")], capture_output=True, text=True, timeout=120,
                            env=os.environ | {"PYTHONPATH": path})
    assert result.returncode == 2
    assert "--pdf" in result.stderr
    assert words in result.stderr
    assert "designing" not in result.stderr
    assert not (tmp_path / "set").exists()
