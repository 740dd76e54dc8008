"""The paper's six mirrors in one set: each built, figs. 5 and 6 as contact sheets, table 1, and a page of it all."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from mirror_cad.spec.file import load_spec
from mirror_studio.as_json import table1_as_json
from mirror_studio.build.folder import MANIFEST, new_set
from mirror_studio.build.pipeline import build_into, hashes, versions, write_json
from mirror_studio.build.results import Built, Compared, Metrics, PaperRow
from mirror_studio.progress import Progress

FIGURE_5 = ("sphere-1250", "sphere-1050", "sphere-950")
FIGURE_6 = ("progressive-a", "progressive-b", "progressive-c")
# Table 1 of Lee et al., Optics Express 22, 25729 (2014): horizontal and vertical field of view (°), lane straightness (%).
PAPER = {"progressive-a": (44.8, 49.4, 27.0), "progressive-b": (44.8, 46.8, 30.0), "progressive-c": (44.8, 42.8, 40.0)}


def table_1(metrics: Mapping[str, Metrics]) -> dict[str, PaperRow]:
    """Our figures beside the paper's, for the three mirrors of table 1.

    Ours are the fields of view of the sections, and the traced straightness.

    Parameters
    ----------
    metrics
        By the names of the mirrors; those of table 1 must be there.
    """
    return {name: PaperRow(Compared(metrics[name].h_fov_deg.section, h_fov),
                           Compared(metrics[name].v_fov_left_deg.section, v_fov),
                           Compared(metrics[name].lane_straightness_percent.traced, lane))
            for name, (h_fov, v_fov, lane) in PAPER.items()}


def build_paper(out: Path, progress: Progress) -> tuple[dict[str, PaperRow], tuple[str, ...]]:
    """Make the whole set in `out`; returns table 1 and what tolerance or limit was missed."""
    from mirror_studio.report.paper_page import contact_sheet, table1_markdown, write_index

    missed: list[str] = []
    with new_set(out) as folder:
        mirrors: list[Built] = []
        for name in FIGURE_5 + FIGURE_6:
            (folder / name).mkdir()
            mirrors.append(build_into(folder / name, load_spec(name), progress))
            missed += [f"{name}: {text}" for text in mirrors[-1].missed]
        progress.step("figures, table 1 and page")
        figures = {}
        for number, title, names in (("5", "Fig. 5: spherical mirrors", FIGURE_5),
                                     ("6", "Fig. 6: horizontally progressive mirrors", FIGURE_6)):
            panels = [(f"({letter}) {name}", folder / name / "driver-view.png")
                      for letter, name in zip("abc", names, strict=True)]
            contact_sheet(folder / f"fig{number}.png", title, panels)
            figures[f"fig{number}"] = f"fig{number}.png"
        table = table_1({built.mirror.spec.name: built.metrics for built in mirrors})
        write_json(folder / "table1.json", table1_as_json(table))
        (folder / "table1.md").write_text(table1_markdown(table), encoding="utf-8")
        write_index(folder / "index.html", mirrors, table, figures)
        write_json(folder / MANIFEST, {"schema": 1, "versions": versions(), "files": hashes(folder)})
    progress.step(f"done: open {out / 'index.html'}")
    return table, tuple(missed)
