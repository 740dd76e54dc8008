"""What the paper's mirrors are worth: its six, the European aspheric and the perspective one on the fronts of the possible.

    mirror-cad optimise paper-front --out exports/paper-front
    mirror-cad sweep perspective-heights --out exports/perspective-heights
    python scripts/paper_fronts.py exports/paper-front exports/perspective-heights docs/pictures/paper-fronts.png

Prints the marked mirrors' figures as a table, and draws lane straightness over what it costs.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from mirror_cad.spec.file import load_spec, spec_as_json
from mirror_studio.explore.evaluate import evaluate

Array = NDArray[np.float64]

SCENE = "motorway"
STRAIGHT = "lane_straightness_percent"
OVER = {"v_fov_left_traced_deg": "vertical field at the left edge, degrees", "magnification_middle": "magnification, middle",
        "magnification_least": "magnification, least", "grid_distortion_rms_arcmin": "distortion of the 1° grid, arc minutes",
        "disparity_max_percent": "largest disparity of the eyes, percent"}
MARKED = {"sphere-950": "5(a)", "sphere-1050": "5(b)", "sphere-1250": "5(c)", "progressive-a": "6(a)", "progressive-b": "6(b)",
          "progressive-c": "6(c)", "european-aspheric": "European aspheric", "perspective": "perspective"}
WIDTH = "h_fov_traced_deg"


def columns(path: Path) -> dict[str, Array]:
    """The figures of a study's table, sizes where they may have either sign; designs that failed are left out."""
    with path.open(encoding="utf-8", newline="") as stream:
        rows = [row for row in csv.DictReader(stream) if row["status"] == "ok"]
    return {name: np.array([abs(float(row[name] or "nan")) for row in rows]) for name in (STRAIGHT, *OVER, WIDTH)}


def marked() -> dict[str, dict[str, float]]:
    names = (STRAIGHT, *OVER, WIDTH)
    found = {}
    for preset in MARKED:
        row = evaluate(0, (), spec_as_json(load_spec(preset)), ".", SCENE, names)
        figures = zip(names, row.figures, strict=True)
        found[preset] = {name: abs(float("nan" if value is None else value)) for name, value in figures}
    return found


def main() -> None:
    laws, heights, picture = (Path(argument) for argument in sys.argv[1:4])
    every, front, views = columns(laws / "rows.csv"), columns(laws / "front.csv"), columns(heights / "rows.csv")
    presets = marked()
    print(f"{'':20s}" + "".join(f"{name:>28s}" for name in (STRAIGHT, *OVER, WIDTH)))
    for preset, figures in presets.items():
        print(f"{preset:20s}" + "".join(f"{figures[name]:28.3f}" for name in (STRAIGHT, *OVER, WIDTH)))
    figure = Figure(figsize=(11.0, 6.6), layout="constrained")
    panels = figure.subplots(2, 3).ravel()
    for axes, (name, title) in zip(panels, OVER.items(), strict=False):
        axes.scatter(every[name], every[STRAIGHT], s=5, color="#cfd6dc", linewidths=0)
        axes.scatter(front[name], front[STRAIGHT], s=9, color="#21918c", linewidths=0)
        axes.scatter(views[name], views[STRAIGHT], s=12, color="#c2410c", marker="^", linewidths=0)
        for preset, label in MARKED.items():
            at = presets[preset][name], presets[preset][STRAIGHT]
            axes.plot(*at, "o", color="#1d2329", markersize=4)
            below = preset in ("progressive-a", "sphere-1250")
            axes.annotate(label, at, xytext=(4, -9 if below else 3), textcoords="offset points", fontsize=7.5)
        axes.set_xlabel(title, fontsize=9)
        axes.set_ylim(-2.0, 62.0)
        axes.tick_params(labelsize=8)
        axes.spines[["top", "right"]].set_visible(False)
    for axes in panels[::3]:
        axes.set_ylabel("lane bends by, percent", fontsize=9)
    legend = panels[-1]
    legend.axis("off")
    for k, (colour, mark, text) in enumerate((
            ("#cfd6dc", "o", "mirrors of two radii across and two upright,\nas wide as the sphere of 950 mm"),
            ("#21918c", "o", "those of them that no other beats in straightness,\nheight and size in the middle"),
            ("#c2410c", "^", "perspective mirrors of the same width,\nlower and higher"), ("#1d2329", "o", "presets"))):
        legend.plot(0.02, 0.9 - 0.22 * k, mark, color=colour, markersize=6)
        legend.text(0.08, 0.9 - 0.22 * k, text, va="center", fontsize=8.5)
    legend.set_xlim(0.0, 1.0)
    legend.set_ylim(0.0, 1.0)
    figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    main()
