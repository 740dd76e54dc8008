"""The page of the six mirrors of Lee et al. (2014): index, table 1 and contact sheets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from mirror_studio.build.results import Built, FieldOfView, PaperRow
from mirror_studio.report.text import MISSING, fixed, fixed_with_unit, lane_in_words, templates, with_unit
from mirror_studio.report.typeface import typeface

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


def write_index(path: Path, mirrors: Sequence[Built], table1: Mapping[str, PaperRow], figures: Mapping[str, str]) -> None:
    """Write index.html beside the mirrors' folders, with links into them and no external requests.

    Parameters
    ----------
    path
        Of the file to write.
    mirrors
        All mirrors, each with a folder of its name beside the page.
    table1
        Ours and the paper's, by the names of the progressive mirrors.
    figures
        The file of “fig5” and of “fig6”, beside the page.
    """
    rows = [_mirror_row(mirror) for mirror in mirrors]
    page = templates().get_template("index.html.j2").render(
        title="Progressive mirrors after Lee et al. (2014)",
        header=list(table1), rows=_table1_rows(table1), mirrors=rows,
        floors=any(text != MISSING for row in rows for text in row.shape),
        lane=lane_in_words(mirrors[0].mirror.spec.scene.lane.model_dump()),
        figures=[(file, FIGURES.get(key, key)) for key, file in figures.items()],
    )
    path.write_text(page, encoding="utf-8")


def table1_markdown(table1: Mapping[str, PaperRow]) -> str:
    """Table 1 as Markdown: ours, the paper's and the difference, degrees and percent."""
    lines = ["| | " + " | ".join(f"{name}, ours | paper | difference" for name in table1) + " |",
             "|---|" + "---:|" * (3 * len(table1))]
    for row in _table1_rows(table1):
        lines.append(f"| {row.name} | " + " | ".join(text for cell in row.cells for text in cell) + " |")
    return "\n".join(lines) + "\n"


@dataclass(frozen=True, slots=True)
class TableRow:
    """A row of table 1 in words: for each mirror ours, the paper's and the difference."""

    name: str
    cells: list[tuple[str, str, str]]


def _table1_rows(table1: Mapping[str, PaperRow]) -> list[TableRow]:
    """The paper's values keep its one decimal."""
    rows = []
    for name, compared in (("H-FOV, °", [row.h_fov_deg for row in table1.values()]),
                           ("V-FOV at the left edge, °", [row.v_fov_left_deg for row in table1.values()]),
                           ("Lane straightness, %", [row.lane_straightness_percent for row in table1.values()])):
        rows.append(TableRow(name, [(fixed(one.ours, 2), fixed(one.paper, 1),
                                     fixed(None if one.ours is None else one.ours - one.paper, 2, sign=True))
                                    for one in compared]))
    return rows


@dataclass(frozen=True, slots=True)
class WorstWords:
    """The largest deviations of k1, k2 and twist, in words."""

    k1: str
    k2: str
    twist: str


@dataclass(frozen=True, slots=True)
class MirrorRow:
    """One mirror of the index, in words; `shape` is by the decoupled and the faithful method."""

    name: str
    laws: tuple[str, str]
    horizontal: tuple[str, str]
    vertical: tuple[str, str]
    lane: tuple[str, str]
    worst: WorstWords
    shape: tuple[str, str]
    numerical: str


def _mirror_row(built: Built) -> MirrorRow:
    def degrees(found: FieldOfView) -> tuple[str, str]:
        return fixed_with_unit(found.section, "°", 2), fixed_with_unit(found.traced, "°", 2)

    spec, metrics, total = built.mirror.spec, built.metrics, built.deviation.total
    lane = metrics.lane_straightness_percent
    k1, k2, twist = (with_unit(one.max_percent, "%", sign=True) for one in (total.k1, total.k2, total.twist))
    both = metrics.methods
    shape = (MISSING, MISSING) if both is None else (with_unit(both.decoupled.deviation.shape.rms_percent, "%"),
                                                     with_unit(both.faithful.deviation.shape.rms_percent, "%"))
    return MirrorRow(spec.name, (spec.horizontal.in_short(), spec.vertical.in_short()),
                     degrees(metrics.h_fov_deg), degrees(metrics.v_fov_left_deg),
                     (fixed_with_unit(lane.traced, "%", 1), fixed_with_unit(lane.image, "%", 1)),
                     WorstWords(k1, k2, twist), shape, "met" if built.deviation.numerical else "not met")


def _scaled(picture: Path | Image.Image, width: int) -> Image.Image:
    opened = picture if isinstance(picture, Image.Image) else Image.open(picture)
    return opened.convert("RGB").resize((width, round(opened.height * width / opened.width)), Image.Resampling.LANCZOS)


def _font(size: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    return typeface("DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf", size)


def _wrapped(text: str, font: ImageFont.FreeTypeFont, width: int) -> list[str]:
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and font.getlength(longer) > width:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines
