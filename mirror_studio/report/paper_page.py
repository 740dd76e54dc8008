"""The six mirrors of Lee et al. (2014) with their figures in; the index page, table 1 and contact sheets out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
from PIL import Image, ImageDraw, ImageFont

from mirror_studio.report.side_by_side import METHODS
from mirror_studio.report.text import MISSING, fixed, fixed_with_unit, lane_in_words, templates, with_unit

# Table 1's rows: key, name, unit. The paper's values keep its one decimal.
MEASURES = (
    ("h_fov_deg", "H-FOV", "°"),
    ("v_fov_left_deg", "V-FOV at the left edge", "°"),
    ("lane_straightness_percent", "Lane straightness", "%"),
)
FIGURES = {
    "fig5": "As figure 5 of the paper: the driver's view in spheres. The smaller the radius, the more is seen, and the "
            "smaller.",
    "fig6": "As figure 6 of the paper: the driver's view in the horizontally progressive mirrors (a) to (c), each "
            "with the horizontal field of view of the 950 mm sphere.",
}

SHEET_WIDTH, SHEET_MARGIN, SHEET_GAP = 1800, 48, 36  # px
TITLE_SIZE, CAPTION_SIZE = 34, 25  # px
INK, SOFT = (29, 35, 41), (70, 80, 88)


def contact_sheet(path: Path, title: str, panels: Sequence[tuple[str, Path | Image.Image]]) -> None:
    """Write a PNG, 1800 px wide, with pictures side by side at one width, each with its caption under it."""
    width = (SHEET_WIDTH - 2 * SHEET_MARGIN - SHEET_GAP * (len(panels) - 1)) // len(panels)
    title_font, caption_font = _font(TITLE_SIZE, bold=True), _font(CAPTION_SIZE)
    pictures = [_scaled(picture, width) for _, picture in panels]
    captions = [_wrapped(caption, caption_font, width) for caption, _ in panels]
    top = SHEET_MARGIN + round(1.9 * TITLE_SIZE) if title else SHEET_MARGIN
    line = round(1.35 * CAPTION_SIZE)
    under = top + max(picture.height for picture in pictures) + 18
    height = under + line * max(len(lines) for lines in captions) + SHEET_MARGIN
    sheet = Image.new("RGB", (SHEET_WIDTH, height), "white")
    pen = ImageDraw.Draw(sheet)
    pen.text((SHEET_MARGIN, SHEET_MARGIN), title, font=title_font, fill=INK)
    for i, (picture, lines) in enumerate(zip(pictures, captions, strict=True)):
        left = SHEET_MARGIN + i * (width + SHEET_GAP)
        sheet.paste(picture, (left, top))
        for k, text in enumerate(lines):
            pen.text((left, under + k * line), text, font=caption_font, fill=SOFT)
    sheet.save(path, "PNG", compress_level=6)


def write_index(path: Path, mirrors: list[dict[str, Any]], table1: dict[str, Any], figures: dict[str, str]) -> None:
    """Write index.html beside the mirrors' folders, with links into them and no external requests.

    mirrors : name, metrics, deviation (as in deviation.json) and spec of each.   table1 : measure → ours and paper, of
    each progressive mirror.   figures : "fig5", "fig6" → file beside the page.
    """
    lanes = [mirror["spec"]["scene"]["lane"] for mirror in mirrors if (mirror.get("spec") or {}).get("scene")]
    rows = [_mirror_row(mirror) for mirror in mirrors]
    page = templates().get_template("index.html.j2").render(
        title="Progressive mirrors after Lee et al. (2014)",
        header=list(table1), rows=_table1_rows(table1), mirrors=rows,
        floors=any(text != MISSING for row in rows for text in row["shape"]),
        lane=lane_in_words(lanes[0]) if lanes else None,
        figures=[(file, FIGURES.get(key, key)) for key, file in figures.items()],
    )
    path.write_text(page, encoding="utf-8")


def table1_markdown(table1: dict[str, Any]) -> str:
    """Table 1 as Markdown: ours, the paper's and the difference, degrees and percent."""
    lines = ["| | " + " | ".join(f"{name}, ours | paper | difference" for name in table1) + " |",
             "|---|" + "---:|" * (3 * len(table1))]
    for row in _table1_rows(table1):
        lines.append(f"| {row['name']} | " + " | ".join(text for cell in row["cells"] for text in cell) + " |")
    return "\n".join(lines) + "\n"


def _table1_rows(table1: Mapping[str, Any]) -> list[dict[str, Any]]:
    rows = []
    for key, name, unit in MEASURES:
        cells = []
        for measures in table1.values():
            both = measures.get(key) or {}
            ours, paper = both.get("ours"), both.get("paper")
            difference = None if ours is None or paper is None else ours - paper
            cells.append((fixed(ours, 2), fixed(paper, 1), fixed(difference, 2, sign=True)))
        rows.append({"name": f"{name}, {unit}", "cells": cells})
    return rows


def _mirror_row(mirror: Mapping[str, Any]) -> dict[str, Any]:
    metrics, total = mirror.get("metrics") or {}, mirror["deviation"]["total"]
    verdicts = mirror["deviation"]["verdicts"]
    worst = {key: with_unit(total.get(f"{key}_max_percent"), "%", sign=True) for key in ("k1", "k2", "twist")}
    methods = metrics.get("methods") or {}
    return {
        "name": mirror["name"],
        "laws": mirror.get("laws") or [],
        "horizontal": _both(metrics.get("h_fov_deg"), ("section", "traced"), "°", 2),
        "vertical": _both(metrics.get("v_fov_left_deg"), ("section", "traced"), "°", 2),
        "lane": _both(metrics.get("lane_straightness_percent"), ("traced", "image"), "%", 1),
        "worst": worst,
        "shape": [with_unit((methods.get(method) or {}).get("shape_rms_percent"), "%") for method in METHODS],
        "numerical": "met" if verdicts["numerical"] else "not met",
    }


def _both(values: Mapping[str, Any] | None, names: tuple[str, str], unit: str, decimals: int) -> list[str]:
    return [fixed_with_unit((values or {}).get(name), unit, decimals) for name in names]


def _scaled(picture: Path | Image.Image, width: int) -> Image.Image:
    opened = picture if isinstance(picture, Image.Image) else Image.open(picture)
    return opened.convert("RGB").resize((width, round(opened.height * width / opened.width)), Image.Resampling.LANCZOS)


def _font(size: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    # Matplotlib brings this face along, so the sheet looks the same wherever it is made.
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name), size)


def _wrapped(text: str, font: ImageFont.FreeTypeFont, width: int) -> list[str]:
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and font.getlength(longer) > width:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines
