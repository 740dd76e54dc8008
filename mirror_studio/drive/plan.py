"""Draw the ground that mirrors show in plan, with lanes, vehicles and eyes, as a PNG file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle

from mirror_studio.drive.drawings import DPI, FAINT, INK, LEFT_EYE, RIGHT_EYE, SIZE, SMALL, SOFT, said_twice, save
from mirror_studio.drive.in_plan import Array, without_cuts
from mirror_studio.drive.measured import Measured
from mirror_studio.drive.world import MM
from mirror_studio.scene_file import SceneFile

REACH_M = (-6.0, 42.0)  # along the road: beyond, what is seen only grows on
BOTH, BLIND = "#8fbfe0", "#e69f00"


def ground_plans(path: Path, mirrors: Sequence[Measured], scene: SceneFile, footprints: Sequence[tuple[str, Array]]) -> None:
    """One plan a mirror, rearward to the right: the ground seen by both eyes, by one only, and the blind zone of the lane.

    footprints : name and corners (n, 2) of (X, Y), mm, of what stands on the road.
    """
    width = abs(_across(mirrors)[1] - _across(mirrors)[0])
    figure = Figure(figsize=(11.0, 0.7 + len(mirrors) * (0.55 + 10.0 * width / (REACH_M[1] - REACH_M[0]))), dpi=DPI,
                    layout="constrained")
    grid: Any = figure.subplots(len(mirrors), 1, squeeze=False, sharex=True)
    for axes, each in zip(grid[:, 0], mirrors, strict=True):
        _plan(axes, each, scene, footprints)
        axes.set_title(each.mirror.name, fontsize=SIZE, fontweight="bold", color=INK, loc="left")
    grid[-1, 0].set_xlabel("X, m behind the ocular points", fontsize=SMALL, color=SOFT)
    handles = [Rectangle((0, 0), 1, 1, color=BOTH, label="seen by both eyes"),
               Rectangle((0, 0), 1, 1, fill=False, edgecolor=LEFT_EYE, label="edge of what the left eye sees"),
               Rectangle((0, 0), 1, 1, fill=False, edgecolor=RIGHT_EYE, label="the right eye"),
               Rectangle((0, 0), 1, 1, facecolor=BLIND, alpha=0.55, label="lane beside: in no view")]
    figure.legend(handles=handles, loc="outside upper center", ncols=4, fontsize=SMALL, frameon=False)
    save(figure, path)


def _across(mirrors: Sequence[Measured]) -> tuple[float, float]:
    """Y, m: from the vehicle's other side to as far as there is room for."""
    left = mirrors[0].mirror.pose.hand == "left"
    return (-15.0, 2.5) if left else (15.0, -2.5)


def _plan(axes: Axes, each: Measured, scene: SceneFile, footprints: Sequence[tuple[str, Array]]) -> None:
    low, high = _across([each])
    axes.set_aspect("equal")
    axes.set_xlim(*REACH_M)
    axes.set_ylim(min(low, high), max(low, high))  # seen from above: with X rearward to the right, Y to the right is upwards
    if scene.road is not None:
        axes.add_patch(Rectangle((REACH_M[0], scene.road.left_m), REACH_M[1] - REACH_M[0],
                                 scene.road.right_m - scene.road.left_m, facecolor="#eceeef", zorder=0, linewidth=0))
        for line in scene.road.line:
            colour = "#d9a400" if line.colour == "yellow" else "#9aa5ae"
            axes.axhline(line.y_m, color=colour, linewidth=1.0, dashes=(6, 6) if line.dash_m else (None, None), zorder=2)
    if each.orientation.twice:
        said_twice(axes)
    else:
        _seen_and_blind(axes, each, low)
    host = each.mirror.host
    axes.add_patch(Rectangle((host.front_mm / MM, -host.half_width_mm / MM), (host.rear_mm - host.front_mm) / MM,
                             2.0 * host.half_width_mm / MM, facecolor="white", edgecolor=INK, linewidth=1.0, zorder=4))
    for name, corners in footprints:
        axes.add_patch(Polygon(corners / MM, facecolor="#c6ccd1", edgecolor=SOFT, linewidth=0.7, zorder=4))
        x, y = corners.mean(axis=0) / MM
        if name and REACH_M[0] < x < REACH_M[1]:
            axes.text(x, y, name, fontsize=6, color=INK, ha="center", va="center", zorder=5, clip_on=True)
    for eye, colour in ((each.mirror.eyes.left, LEFT_EYE), (each.mirror.eyes.right, RIGHT_EYE)):
        axes.plot(eye[0] / MM, eye[1] / MM, marker="o", markersize=2.5, color=colour, zorder=6)
    at = each.mirror.pose.to_vehicle(np.zeros(3)) / MM
    axes.plot(at[0], at[1], marker="|", markersize=7, color=INK, zorder=6)
    axes.tick_params(labelsize=SMALL, colors=SOFT, length=2.5)
    axes.set_ylabel("Y, m", fontsize=SMALL, color=SOFT)
    for spine in axes.spines.values():
        spine.set_color(FAINT)


def _seen_and_blind(axes: Axes, each: Measured, low: float) -> None:
    """The ground that each eye sees, the blind zone, and the widths seen."""
    for outline in each.ground.both.outlines:
        axes.add_patch(Polygon(outline / MM, facecolor=BOTH, alpha=0.75, linewidth=0, zorder=1))
    for seen, colour in ((each.ground.left, LEFT_EYE), (each.ground.right, RIGHT_EYE)):
        for outline in seen.outlines:
            axes.plot(*(without_cuts(outline) / MM).T, color=colour, linewidth=1.1, zorder=3)
    for outline in each.blind[-1].outlines:
        axes.add_patch(Polygon(outline / MM, facecolor=BLIND, alpha=0.55, linewidth=0, zorder=2))
    for seen_width in each.widths:
        for span in seen_width.either:
            axes.plot([seen_width.x_mm / MM] * 2, np.clip(span / MM, -60.0, 60.0), color=SOFT, linewidth=0.8, zorder=3)
        if seen_width.either_mm > 0.0:
            axes.text(seen_width.x_mm / MM + 0.2, 1.25 * np.sign(-low), f"{seen_width.either_mm / MM:.1f} m", fontsize=6.5,
                      color=SOFT, va="center", zorder=5)
