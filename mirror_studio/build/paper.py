"""The paper's six mirrors in one set: each built, figs. 5 and 6 as contact sheets, table 1, and a page of it all."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mirror_cad.spec.file import load_spec, spec_as_json
from mirror_studio.build.folder import MANIFEST, new_set
from mirror_studio.build.pipeline import Built, build_into, hashes, versions, write_json
from mirror_studio.progress import Progress

FIGURE_5 = ("sphere-1250", "sphere-1050", "sphere-950")
FIGURE_6 = ("progressive-a", "progressive-b", "progressive-c")
# Table 1 of Lee et al., Optics Express 22, 25729 (2014).
PAPER = {
    "progressive-a": {"h_fov_deg": 44.8, "v_fov_left_deg": 49.4, "lane_straightness_percent": 27.0},
    "progressive-b": {"h_fov_deg": 44.8, "v_fov_left_deg": 46.8, "lane_straightness_percent": 30.0},
    "progressive-c": {"h_fov_deg": 44.8, "v_fov_left_deg": 42.8, "lane_straightness_percent": 40.0},
}
# Which of our two figures stands beside the paper's.
OURS = {"h_fov_deg": "section", "v_fov_left_deg": "section", "lane_straightness_percent": "traced"}


def table_1(metrics: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Our figures beside the paper's, for the three mirrors of table 1."""
    return {name: {key: {"ours": metrics[name][key][OURS[key]], "paper": value} for key, value in figures.items()}
            for name, figures in PAPER.items()}


def build_paper(out: Path, progress: Progress) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Make the whole set in `out`; returns table 1 and what tolerance or limit was missed."""
    from mirror_studio.report import contact_sheet, table1_markdown, write_index

    missed: list[str] = []
    with new_set(out) as folder:
        mirrors: list[dict[str, Any]] = []
        metrics: dict[str, dict[str, Any]] = {}
        for name in FIGURE_5 + FIGURE_6:
            (folder / name).mkdir()
            built: Built = build_into(folder / name, load_spec(name), progress)
            missed += [f"{name}: {text}" for text in built.missed]
            metrics[name] = built.metrics
            mirrors.append({"name": name, "metrics": built.metrics, "deviation": built.deviation.as_json(),
                            "spec": spec_as_json(built.mirror.spec),
                            "laws": [built.mirror.spec.horizontal.in_short(), built.mirror.spec.vertical.in_short()]})
        progress.step("figures, table 1 and page")
        figures = {}
        for number, title, names in (("5", "Fig. 5: spherical mirrors", FIGURE_5),
                                     ("6", "Fig. 6: horizontally progressive mirrors", FIGURE_6)):
            panels = [(f"({letter}) {name}", folder / name / "driver-view.png")
                      for letter, name in zip("abc", names, strict=True)]
            contact_sheet(folder / f"fig{number}.png", title, panels)
            figures[f"fig{number}"] = f"fig{number}.png"
        table = table_1(metrics)
        write_json(folder / "table1.json", table)
        (folder / "table1.md").write_text(table1_markdown(table), encoding="utf-8")
        write_index(folder / "index.html", mirrors, table, figures)
        write_json(folder / MANIFEST, {"schema": 1, "versions": versions(), "files": hashes(folder)})
    progress.step(f"done: open {out / 'index.html'}")
    return table, tuple(missed)
