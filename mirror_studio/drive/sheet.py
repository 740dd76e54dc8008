"""A scene and its measured mirrors in, the page that sets them side by side out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mirror_studio.drive.measured import Measured
from mirror_studio.drive.table import cells, rows_of
from mirror_studio.report.text import fixed, law_in_short, plain, templates
from mirror_studio.scene_file import AimSection, SceneFile

SENSITIVE = (("horizon_either_deg", "horizon, either eye, °", 2), ("flank_share", "own flank, of width", 3),
             ("horizon_share", "horizon, of height", 3), ("width_at_20_m", "ground seen at 20 m, m", 2),
             ("blind_length_m", "lane beside in no view, m", 2))


def picture_name(mirror: str) -> str:
    """The file of what both eyes see in a mirror."""
    return f"{mirror}-eyes.png"


def write_sheet(path: Path, scene: SceneFile, measured: Sequence[Measured], figures: Sequence[Mapping[str, Any]],
                left_out: Sequence[str] = ()) -> None:
    """Write index.html, which shows the pictures and drawings beside it; left_out : what of the scene is, in words."""
    groups = [(group, [(row, cells(row, figures)) for row in rows]) for group, rows in rows_of(figures[0])]
    mirrors = [{"name": each.mirror.name, "picture": picture_name(each.mirror.name), "caption": _caption(each, one),
                "sensitivity": [(name, [_sensitive(values, key, decimals) for key, _, decimals in SENSITIVE])
                                for name, values in one["sensitivity"].items()]}
               for each, one in zip(measured, figures, strict=True)]
    page = templates().get_template("drive.html.j2").render(
        title=f"Scene {scene.name}: {', '.join(each.mirror.name for each in measured)}", lead=_lead(scene),
        facts=_facts(scene, left_out), mirrors=mirrors, groups=groups, line_y=plain(scene.measured.line_y_m),
        direct=f"lane lines; direct view ends {plain(scene.measured.direct_view_deg)}° from straight ahead",
        hidden=plain(scene.measured.hidden_height_m), sensitivity_titles=[title for _, title, _ in SENSITIVE])
    path.write_text(page, encoding="utf-8")


def _sensitive(values: Mapping[str, Any], key: str, decimals: int) -> str:
    """A figure with "≥" before the length of a zone that goes on where looking ends."""
    return ("≥ " if key == "blind_length_m" and values["blind_endless"] else "") + fixed(values[key], decimals)


def _caption(each: Measured, figures: Mapping[str, Any]) -> str:
    spec = each.mirror.spec
    laws = "" if spec is None else " × ".join(_law(getattr(spec, key)) for key in ("horizontal", "vertical")) + "; "
    field, size = figures["field_deg"], figures["magnification"]["horizontal"]
    return (f"{laws}yaw {fixed(figures['aim']['yaw_deg'], 1)}°, pitch {fixed(figures['aim']['pitch_deg'], 1)}°; horizon "
            f"{fixed(field['horizon_either'], 1)}° by either eye; far things {fixed(size['middle'], 2)} times as wide as in a "
            f"flat mirror in the middle, {fixed(size['least'], 2)} times at the least")


def _law(law: Any) -> str:
    """A law in a few words: a formula is too long to be read here."""
    return "a formula" if law.law == "expression" else law_in_short(law.model_dump(exclude_none=True))


def _lead(scene: SceneFile) -> str:
    if scene.mirror.yaw_deg is not None:
        return "The same vehicle, road, light and pose for every mirror."
    return "The same vehicle, road, light and aim for every mirror: flank and horizon lie at the same places in each."


def _facts(scene: SceneFile, left_out: Sequence[str]) -> list[tuple[str, str]]:
    eyes, mirror, light = scene.eyes, scene.mirror, scene.light
    aim = scene.aim or AimSection()
    posed = (f"yaw {plain(mirror.yaw_deg)}°, pitch {plain(mirror.pitch_deg or 0.0)}°" if mirror.yaw_deg is not None else
             f"aimed from between the eyes: own flank on {plain(100 * aim.flank_share)} % of the width, "
             f"horizon at {plain(100 * aim.horizon_share)} % of the height")
    return [
        ("Coordinates", "X rearward from the ocular points, Y to the right from the vehicle's median plane, Z up from the "
                        "ground"),
        ("Eyes", f"({_triple(eyes.middle_m)}) m, {plain(1000 * eyes.separation_m)} mm apart"),
        ("Mirror", f"{mirror.hand}, centre at ({_triple(mirror.centre_m)}) m; {posed}; reflectance {plain(mirror.reflectance)}"
                   + (f"; bezel over {plain(1000 * mirror.bezel_over_m)} mm of the edge" if mirror.bezel_over_m else "")),
        ("Own vehicle", f"{plain(scene.own_vehicle.width_m)} m wide, its rear at X = {plain(scene.own_vehicle.rear_m)} m"),
        *(("Left out", text) for text in left_out),
        ("Light", f"sun {plain(light.elevation_deg)}° high, {plain(abs(light.azimuth_deg))}° to the "
                  f"{'left' if light.azimuth_deg < 0 else 'right'} of straight ahead; turbidity {plain(light.turbidity)} (the "
                  "sky of Preetham, Shirley and Smits, 1999)"),
    ]


def _triple(values: Sequence[float]) -> str:
    return ", ".join(plain(value) for value in values)
