"""Draw the ground that mirrors show in plan, with lanes, vehicles and eyes; SVG."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mirror_studio.drive.drawings import LEFT_EYE, RIGHT_EYE, said_twice
from mirror_studio.drive.in_plan import Array, without_cuts
from mirror_studio.drive.measured import Measured
from mirror_studio.drive.world import MM
from mirror_studio.report.drawing import INK, SOFT, WIDTH, Panel, Range, drawing, legend, text
from mirror_studio.scene_file import SceneFile

REACH_M = (-6.0, 42.0)  # along the road: beyond, what is seen only grows on
BOTH, BLIND = "#8fbfe0", "#e69f00"
ROAD, BODY, WHITE_LINE, YELLOW_LINE = "#eceeef", "#c6ccd1", "#9aa5ae", "#d9a400"
LEFT, RIGHT, TOP, TITLE, BETWEEN, BELOW = 52.0, 10.0, 30.0, 18.0, 26.0, 40.0  # px
SMALLEST = 10.5  # px, of the words in a plan
KEYS = (("seen by both eyes", BOTH, 11.0, 0.75, ""), ("edge of what the left eye sees", LEFT_EYE, 1.8, 1.0, ""),
        ("the right eye", RIGHT_EYE, 1.8, 1.0, ""), ("lane beside: in no view", BLIND, 11.0, 0.55, ""))


def ground_plans(path: Path, mirrors: Sequence[Measured], scene: SceneFile, footprints: Sequence[tuple[str, Array]]) -> None:
    """Write one plan a mirror, rearward to the right.

    It has the ground seen by both eyes, by one only, and the blind zone of the lane.

    footprints : name and corners (n, 2) of (X, Y), mm, of what stands on the road.
    """
    across, width = _across(mirrors[0]), WIDTH - LEFT - RIGHT
    height = width * (across[1] - across[0]) / (REACH_M[1] - REACH_M[0])
    parts, top = [legend(WIDTH - RIGHT, 12.0, KEYS)], TOP - BETWEEN
    for k, each in enumerate(mirrors):
        top += TITLE + BETWEEN
        panel = Panel(LEFT, top, width, height, REACH_M, across)  # from above: with X to the right, Y to the right is upwards
        _plan(panel, each, scene, footprints)
        last = k == len(mirrors) - 1
        parts.append(panel.svg(k, each.mirror.name, "X, m behind the ocular points" if last else "", "", grid=False))
        parts.append(text(14.0, top + 0.5 * height, "Y, m", colour=SOFT, anchor="middle", upright=True))
        top += height
    path.write_bytes(drawing(top + BELOW, parts))


def _across(each: Measured) -> Range:
    """Y, m: from the vehicle's other side to as far as there is room for."""
    return (-15.0, 2.5) if each.mirror.pose.hand == "left" else (-2.5, 15.0)


def _plan(panel: Panel, each: Measured, scene: SceneFile, footprints: Sequence[tuple[str, Array]]) -> None:
    if scene.road is not None:
        panel.area(*_rectangle(*REACH_M, scene.road.left_m, scene.road.right_m), ROAD)
    if not each.orientation.twice:
        for outline in each.ground.both.outlines:
            panel.area(*_metres(outline), BOTH, 0.75)
        for outline in each.blind[-1].outlines:
            panel.area(*_metres(outline), BLIND, 0.55)
    for line in scene.road.line if scene.road is not None else ():
        panel.level(line.y_m, YELLOW_LINE if line.colour == "yellow" else WHITE_LINE, 1.3, "9 9" if line.dash_m else "")
    if each.orientation.twice:
        panel.parts += said_twice(panel.left + 0.5 * panel.width, panel.top + 0.25 * panel.height)
    else:
        _edges_and_widths(panel, each)
    host = each.mirror.host
    panel.area(*_rectangle(host.front_mm / MM, host.rear_mm / MM, -host.half_width_mm / MM, host.half_width_mm / MM), "white",
               1.0, INK, 1.2)
    for name, corners in footprints:
        panel.area(*_metres(corners), BODY, 1.0, SOFT, 0.9)
        x, y = corners.mean(axis=0) / MM
        if name and REACH_M[0] < x < REACH_M[1]:
            _words(panel, x, y, name, "middle")
    for eye, colour in ((each.mirror.eyes.left, LEFT_EYE), (each.mirror.eyes.right, RIGHT_EYE)):
        (a,), (b,) = panel.px(*_metres(eye[None]))
        panel.parts.append(f'<circle cx="{a:.1f}" cy="{b:.1f}" r="2" fill="{colour}"/>')
    (a,), (b,) = panel.px(*_metres(each.mirror.pose.to_vehicle(np.zeros((1, 3)))))
    panel.parts.append(f'<path d="M{a:.1f} {b - 4.5:.1f}v9" stroke="{INK}" stroke-width="1.6"/>')


def _edges_and_widths(panel: Panel, each: Measured) -> None:
    """The edges of what each eye sees of the ground, and the widths seen."""
    for seen, colour in ((each.ground.left, LEFT_EYE), (each.ground.right, RIGHT_EYE)):
        for outline in seen.outlines:
            panel.line(*_metres(without_cuts(outline)), colour, 1.5)
    beside = 1.25 if each.mirror.pose.hand == "left" else -1.25
    for width in each.widths:
        at = width.x_mm / MM
        for span in width.either:
            panel.line((at, at), np.clip(span / MM, -60.0, 60.0), SOFT, 1.0)
        if width.either_mm > 0.0:
            _words(panel, at + 0.2, beside, f"{width.either_mm / MM:.1f} m", "start")


def _words(panel: Panel, x: float, y: float, words: str, anchor: str) -> None:
    (a,), (b,) = panel.px(np.array([x]), np.array([y]))
    panel.parts.append(text(a, b + 0.35 * SMALLEST, words, SMALLEST, INK, anchor, halo=True))


def _metres(points: Array) -> tuple[Array, Array]:
    """X and Y of points (n, ≥ 2), mm, in metres."""
    return points[:, 0] / MM, points[:, 1] / MM


def _rectangle(x_from: float, x_to: float, y_from: float, y_to: float) -> tuple[list[float], list[float]]:
    return [x_from, x_to, x_to, x_from], [y_from, y_from, y_to, y_to]
