"""Figures of several mirrors in, the table that sets them side by side out: for people and as CSV."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mirror_studio.report.text import fixed


@dataclass(frozen=True, slots=True)
class Row:
    """A figure: where it is in measures.json (keys and list indices, with dots between), what it is called, its unit and
    decimals, and how it is defined."""

    path: str
    title: str
    unit: str
    decimals: int
    definition: str

    def of(self, figures: Mapping[str, Any]) -> Any:
        """The value, None where there is none."""
        value: Any = figures
        for key in self.path.split("."):
            if value is None:
                return None
            value = value[int(key) if isinstance(value, list) else key]
        return value


AIM = (
    Row("image.way", "far things are shown", "", 0,
        "beside a flat mirror; of one that shows some things twice, no field, size, line or ground is measured"),
    Row("aim.yaw_deg", "yaw", "°", 2,
        "about the vertical, from facing straight rearward towards the vehicle"),
    Row("aim.pitch_deg", "pitch", "°", 2,
        "then about the mirror's own horizontal axis, upwards"),
    Row("aim.flank_share", "own flank", "of width", 3,
        "share of the width, from the inboard edge, that the own flank takes on the row of the horizon, from between the eyes"),
    Row("aim.horizon_share", "horizon", "of height", 3,
        "share of the height, from the lower edge, at which the horizon lies in the middle of the width"),
    Row("aim.above_horizon_deg", "shown above the horizon", "°", 2,
        "elevation of the ray at the upper edge, in the middle of the width"),
)
FIELD = (
    Row("field_deg.between_edges", "between the edges", "°", 2,
        "angle between the rays reflected at the mirror's two edges, y = 0, for an eye between the two"),
    Row("field_deg.horizon_left", "horizon, left eye", "°", 2,
        "azimuths of the horizon that the left eye sees beside the own vehicle"),
    Row("field_deg.horizon_right", "horizon, right eye", "°", 2,
        "the same for the right eye"),
    Row("field_deg.horizon_either", "horizon, either eye (ambinocular)", "°", 2,
        "azimuths that one eye sees at least"),
    Row("field_deg.horizon_both", "horizon, both eyes (binocular)", "°", 2,
        "azimuths that both eyes see"),
    Row("field_deg.upright_either", "upright, either eye", "°", 2,
        "elevations shown at the azimuth of the mirror's middle, beside the own vehicle"),
)
SIZE = (
    Row("magnification.horizontal.middle", "horizontal magnification, middle", "", 3,
        "seen size of a far, level object over that in a flat mirror at the same place"),
    Row("magnification.horizontal.least", "horizontal magnification, least", "", 3,
        "over the mirror"),
    Row("magnification.vertical.middle", "vertical magnification, middle", "", 3,
        "the same of an upright object"),
    Row("magnification.ratio.least", "horizontal over vertical, least", "", 3,
        "below 1 things look too slim"),
)
STRAIGHTNESS = (
    Row("lane_line.bow_arcmin", "lane bow", "′", 1,
        "largest angle between the image of the lane line on the road and the great circle through its ends, positive upwards"),
    Row("lane_line.straightness_percent", "lane straightness on the road", "%", 1,
        "|Δy_curve| − |Δy_line| over |Δy_line|, the line being the image's tangent at its far end"),
    Row("lane_line.reference_plane_percent", "lane straightness on the reference plane", "%", 1,
        "the paper's: the mirror not turned, a lane across all of it on a plane behind the eye"),
    Row("column.tilt_arcmin", "column tilt", "′", 1,
        "how far the column's image leans to the right"),
    Row("column.own_tilt_arcmin", "column tilt by the mirror's curvature", "′", 1,
        "less that of a flat mirror tangent there"),
    Row("grid.rms_arcmin", "distortion of the 1° grid, RMS", "′", 1,
        "angle at the eye from the affine map that fits best"),
    Row("grid.max_arcmin", "distortion of the 1° grid, largest", "′", 1,
        "the same"),
)
TWO_EYES = (
    Row("disparity.max_percent", "binocular disparity, largest", "%", 2,
        "difference of the horizontal size of a far object between the eyes, of their mean"),
    Row("disparity.max_rate_percent_per_mm", "its largest rate of change", "%/mm", 3,
        "along a row of the mirror"),
)


def rows_of(figures: Mapping[str, Any]) -> tuple[tuple[str, tuple[Row, ...]], ...]:
    """The table's rows in groups; those of distances and heights as a mirror's figures have them."""
    return (("Aim", AIM), ("Field of view", FIELD), ("Size", (*SIZE, *_sizes(figures))), ("Straightness", STRAIGHTNESS),
            ("Two eyes", TWO_EYES), ("Ground and blind zone", (*_ground(figures), *_blind(figures))))


def _sizes(figures: Mapping[str, Any]) -> list[Row]:
    rows = []
    for k, one in enumerate(figures["angular_size"]):
        for side, ends in (("width", "its two sides at half its height"), ("height", "its lower and upper edge")):
            title = f"vehicle at {one['distance_m']:g} m, {side}"
            rows.append(Row(f"angular_size.{k}.mirror_arcmin.{side}", title, "′", 1,
                            f"angle at the eye between what the mirror shows of {ends}; none where it is not wholly shown"))
            rows.append(Row(f"angular_size.{k}.flat_arcmin.{side}", f"{title}, flat mirror", "′", 1,
                            "the same in a flat mirror in its place"))
    return rows


def _ground(figures: Mapping[str, Any]) -> list[Row]:
    rows = [Row(f"ground.seen_width_m.{k}.{eyes}", f"ground seen {one['at_m']:g} m behind the eyes, {word}", "m", 2,
                "width of the ground seen outward of the plane of the flank, without a gap")
            for k, one in enumerate(figures["ground"]["seen_width_m"])
            for eyes, word in (("either", "by either eye"), ("both", "by both"))]
    return [*rows, Row("ground.nearest_at_flank_m.either", "nearest ground beside the flank", "m", 2,
                       "smallest distance behind the eyes at which the ground 0.1 m beside the flank is seen by either eye")]


def _blind(figures: Mapping[str, Any]) -> list[Row]:
    rows = []
    for k, one in enumerate(figures["blind_zone"]["at"]):
        where = f"{one['height_m']:g} m high" if one["height_m"] else "on the ground"
        rows.append(Row(f"blind_zone.at.{k}.length_m", f"lane beside in no view, {where}, length", "m", 2,
                        "along the lane's middle: neither in the mirror, for either eye, nor before the limit of direct view"))
        rows.append(Row(f"blind_zone.at.{k}.area_m2", f"lane beside in no view, {where}, area", "m²", 2,
                        "of the lane between its lines"))
    return [*rows, Row("blind_zone.longest_hidden_car_m", "longest car that hides", "m", 2,
                       "1.8 m wide, wholly in no view at both heights")]


def write_csv(path: Path, names: Sequence[str], figures: Sequence[Mapping[str, Any]]) -> None:
    """The table with unrounded values, one row a figure; empty where a mirror does not show what is measured."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["group", "figure", "unit", *names])
        for group, rows in rows_of(figures[0]):
            for row in rows:
                values = (row.of(each) for each in figures)
                writer.writerow([group, row.title, row.unit, *(
                    "" if one is None else one if isinstance(one, str) else repr(float(one)) for one in values)])


def cells(row: Row, figures: Sequence[Mapping[str, Any]]) -> list[str]:
    """A row's values, to the decimals that it has, or words; "≥" before what goes on where looking ends."""
    zone = row.path.startswith("blind_zone.at.")
    return [("≥ " if zone and each["blind_zone"]["at"][int(row.path.split(".")[2])]["endless"] else "")
            + (value if isinstance(value := row.of(each), str) else fixed(value, row.decimals)) for each in figures]
