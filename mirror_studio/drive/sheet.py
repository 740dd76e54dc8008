"""The page that sets the mirrors of a scene side by side."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from mirror_cad.laws.words import plain
from mirror_studio.drive.measured import MainFigures, Measured, spread_of
from mirror_studio.drive.pictures import EYE_HEIGHT_PX, EYE_WIDTH_PX, camera_at
from mirror_studio.drive.table import ORIENTATION_DEFINITION, ORIENTATION_TITLE, cells, groups_of, orientations
from mirror_studio.report.text import fixed, templates
from mirror_studio.scene_file import AimSection, SceneFile
from raytrace.measures.asked import Asked
from raytrace.measures.eye_fields import extent

SENSITIVE = (("horizon_either_deg", "horizon, either eye, °", 2), ("flank_share", "host vehicle's flank, of width", 3),
             ("horizon_share", "horizon, of height", 3), ("width_at_20_m", "ground seen at 20 m, m", 2),
             ("blind_length_m", "lane beside in no view, m", 2))

SAME_SCALE = 0.01  # of a pixel's size: less is not seen between pictures side by side


def picture_name(mirror: str) -> str:
    """The file of what both eyes see in a mirror."""
    return f"{mirror}-eyes.png"


def write_sheet(path: Path, scene: SceneFile, measured: Sequence[Measured],
                changes: Sequence[Mapping[str, MainFigures]], lines_width: float, left_out: Sequence[str] = ()) -> None:
    """Write index.html, which shows the pictures and drawings beside it.

    lines_width : of the lines' drawing, of the page's.   left_out : what of bodies is not drawn.
    """
    groups = [(group, [(row, cells(row, measured)) for row in rows]) for group, rows in groups_of(measured)]
    mirrors = [{"name": each.mirror.name, "picture": picture_name(each.mirror.name), "caption": _caption(each),
                "sensitivity": [(name, [_sensitive(values, key, decimals) for key, _, decimals in SENSITIVE])
                                for name, values in change.items()]}
               for each, change in zip(measured, changes, strict=True)]
    page = templates().get_template("drive.html.j2").render(
        title=f"Scene {scene.name}: {', '.join(each.mirror.name for each in measured)}",
        facts=_facts(scene, left_out) + [("Hand", each.mirror.of_other_hand) for each in measured if each.mirror.of_other_hand],
        lead=_lead(scene) if len(measured) > 1 else "", one_scale=_one_scale(measured),
        lines_percent=f"{100.0 * lines_width:.1f}", radii_of=_designed(measured),
        mirrors=mirrors, groups=groups, way=(ORIENTATION_TITLE, ORIENTATION_DEFINITION, orientations(measured)),
        lines=_lines(measured[0].asked, scene),
        direct=f"{plain(scene.measured.direct_view_deg)}° from straight ahead",
        hidden=plain(scene.measured.hidden_height_m), sensitivity_titles=[title for _, title, _ in SENSITIVE])
    path.write_text(page, encoding="utf-8")


def _one_scale(measured: Sequence[Measured]) -> bool:
    """Whether the eyes' pictures of all mirrors have pixels of one size: those of one size that are turned alike."""
    pixels = [camera_at(each.mirror, each.mirror.views.middle, EYE_WIDTH_PX, EYE_HEIGHT_PX)[1] for each in measured]
    return max(pixels) <= min(pixels) * (1.0 + SAME_SCALE)


def _designed(measured: Sequence[Measured]) -> str:
    """Of which mirrors the radii could be changed: a file has none."""
    designed = sum(each.mirror.spec is not None for each in measured)
    return "all" if designed == len(measured) else "some" if designed else "none"


def _lines(asked: Asked, scene: SceneFile) -> str:
    """What is drawn beside the grid, as far as the scene has it."""
    lane = f"; the lane line at Y = {plain(scene.measured.line_y_m)} m with the chord of its image"
    return (lane if asked.line_y is not None else "") + ("; the column" if asked.column is not None else "")


def _sensitive(values: MainFigures, key: str, decimals: int) -> str:
    """A figure with "≥" before the length of a zone that goes on where looking ends."""
    return ("≥ " if key == "blind_length_m" and values.blind_endless else "") + fixed(getattr(values, key), decimals)


def _caption(each: Measured) -> str:
    spec, pose, size = each.mirror.spec, each.mirror.pose, spread_of(each, "horizontal")
    laws = ""
    if spec is not None:
        laws = f"{spec.target.in_words()}; " if spec.target else f"{spec.horizontal.in_short()} × {spec.vertical.in_short()}; "
    field = None if each.orientation.twice else extent(each.fields.horizon_clear.either)
    return (f"{laws}yaw {fixed(math.degrees(pose.yaw), 1)}°, pitch {fixed(math.degrees(pose.pitch), 1)}°; horizon "
            f"{fixed(field, 1)}° by either eye; far things {fixed(size.middle, 2)} times as wide as in a "
            f"flat mirror in the middle, {fixed(size.least, 2)} times at the least")


def _lead(scene: SceneFile) -> str:
    if scene.mirror.yaw_deg is not None:
        return "The same vehicle, road, light and pose for every mirror."
    return "The same vehicle, road, light and aim for every mirror: flank and horizon lie at the same places in each."


def _facts(scene: SceneFile, left_out: Sequence[str]) -> list[tuple[str, str]]:
    eyes, mirror, light = scene.eyes, scene.mirror, scene.light
    aim = scene.aim or AimSection()
    posed = (f"yaw {plain(mirror.yaw_deg)}°, pitch {plain(mirror.pitch_deg or 0.0)}°" if mirror.yaw_deg is not None else
             f"aimed from between the eyes: host vehicle's flank on {plain(100 * aim.flank_share)} % of the width, "
             f"horizon at {plain(100 * aim.horizon_share)} % of the height")
    return [
        ("Coordinates", "X rearward from the ocular points, Y to the right from the vehicle's median plane, Z up from the "
                        "ground"),
        ("Eyes", f"({_triple(eyes.middle_m)}) m, {plain(1000 * eyes.separation_m)} mm apart"),
        ("Mirror", f"{mirror.hand}, centre at ({_triple(mirror.centre_m)}) m; {posed}; reflectance {plain(mirror.reflectance)}"
                   + (f"; bezel over {plain(1000 * mirror.bezel_over_m)} mm of the edge" if mirror.bezel_over_m else "")),
        ("Host vehicle", f"{plain(scene.own_vehicle.width_m)} m wide, its rear at X = {plain(scene.own_vehicle.rear_m)} m"),
        *(("Left out", text) for text in left_out),
        ("Light", f"sun {plain(light.elevation_deg)}° high, {plain(abs(light.azimuth_deg))}° to the "
                  f"{'left' if light.azimuth_deg < 0 else 'right'} of straight ahead; turbidity {plain(light.turbidity)} (the "
                  "sky of Preetham, Shirley and Smits, 1999)"),
    ]


def _triple(values: Sequence[float]) -> str:
    return ", ".join(plain(value) for value in values)
