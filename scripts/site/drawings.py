"""A measure's name in, a small drawing of what it measures out, as SVG."""

from __future__ import annotations

import io
from collections.abc import Callable
from functools import partial

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Polygon, Rectangle, Wedge

INK, MARKED, SOFT, GROUND = "#333333", "#1f5fa8", "#9db8d6", "#e4ebf3"
WIDTH_IN, HEIGHT_IN = 3.6, 2.4
STYLE = {"svg.hashsalt": "mirror-cad", "font.size": 8.0, "lines.linewidth": 1.1, "lines.solid_capstyle": "round"}
Draw = Callable[["Sheet"], None]


class Sheet:
    """A drawing of 36 × 24 units without axes."""

    def __init__(self) -> None:
        self.figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN))
        self.axes = self.figure.add_axes((0.0, 0.0, 1.0, 1.0), aspect="equal", xlim=(0.0, 36.0), ylim=(0.0, 24.0))
        self.axes.set_axis_off()

    def line(self, *points: tuple[float, float], colour: str = INK, style: str = "-", wide: float = 1.1) -> None:
        self.axes.plot(*np.array(points).T, style, color=colour, linewidth=wide)

    def curve(self, x: object, y: object, colour: str = INK, style: str = "-", wide: float = 1.1) -> None:
        self.axes.plot(x, y, style, color=colour, linewidth=wide)

    def area(self, *points: tuple[float, float], colour: str = GROUND, edge: str = "none") -> None:
        self.axes.add_patch(Polygon(np.array(points), closed=True, facecolor=colour, edgecolor=edge, zorder=0.5))

    def box(self, x: float, y: float, width: float, height: float, fill: str = "none", edge: str = INK) -> None:
        self.axes.add_patch(Rectangle((x, y), width, height, facecolor=fill, edgecolor=edge, zorder=0.8))

    def wedge(self, at: tuple[float, float], radius: float, start: float, end: float, colour: str = SOFT) -> None:
        self.axes.add_patch(Wedge(at, radius, start, end, facecolor=colour, edgecolor="none", alpha=0.55, zorder=0.6))

    def angle(self, at: tuple[float, float], radius: float, start: float, end: float, text: str = "") -> None:
        self.axes.add_patch(Arc(at, 2 * radius, 2 * radius, theta1=start, theta2=end, color=MARKED, linewidth=1.4))
        middle = np.radians(0.5 * (start + end))
        if text:
            self.text(at[0] + (radius + 1.6) * np.cos(middle), at[1] + (radius + 1.6) * np.sin(middle), text, MARKED)

    def arrow(self, start: tuple[float, float], end: tuple[float, float], colour: str = INK, both: bool = False) -> None:
        self.axes.annotate("", end, start, arrowprops={"arrowstyle": "<|-|>" if both else "-|>", "color": colour,
                                                       "linewidth": 1.1, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 7})

    def size(self, start: tuple[float, float], end: tuple[float, float], text: str, aside: tuple[float, float]) -> None:
        """A dimension, with its text beside the middle."""
        self.arrow(start, end, MARKED, both=True)
        self.text(0.5 * (start[0] + end[0]) + aside[0], 0.5 * (start[1] + end[1]) + aside[1], text, MARKED)

    def text(self, x: float, y: float, text: str, colour: str = INK, align: str = "center") -> None:
        self.axes.text(x, y, text, color=colour, ha=align, va="center")

    def eye(self, x: float, y: float, text: str = "") -> None:
        self.axes.plot(x, y, "o", color=INK, markersize=4.5)
        if text:
            self.text(x, y - 1.4, text)

    def svg(self) -> str:
        stream = io.StringIO()
        with rc_context(STYLE):
            self.figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
        text = stream.getvalue()
        return text[text.index("<svg"):]


def drawing(name: str, group: str = "Other") -> str:
    """The SVG text of a measure's drawing; of one without a drawing of its own, that of its group."""
    with rc_context(STYLE):
        sheet = Sheet()
        (_own(name) or OF_GROUP[group])(sheet)
        return sheet.svg()


def _own(name: str) -> Draw | None:
    return DRAWINGS.get(name) or of_family(name)


# ---- parts that several drawings share

def mirror_face(s: Sheet, x: float = 6.0, y: float = 3.0, width: float = 20.0, height: float = 17.0) -> None:
    """The mirror as the driver sees it: outboard left, inboard right."""
    s.box(x, y, width, height, "#f7f9fc")


ARC_RADIUS, ARC_HALF, ARC_AT = 16.0, 20.0, (8.5, 11.0)  # of a convex section that faces right, and its foremost point


def field(s: Sheet, eye: tuple[float, float], upright: bool, text: str) -> None:
    """The rays reflected at the two ends of a section, and the angle between them."""
    turn = np.radians(np.linspace(-ARC_HALF, ARC_HALF, 60))
    x, y = ARC_AT[0] - ARC_RADIUS * (1.0 - np.cos(turn)), ARC_AT[1] + ARC_RADIUS * np.sin(turn)
    s.curve(x, y, wide=2.2)
    s.text(0.8, 22.6, "section, upright" if upright else "section, in plan", align="left")
    ends, outs = [], []
    for k, normal in ((0, -ARC_HALF), (-1, ARC_HALF)):
        at = np.array([x[k], y[k]])
        s.line(eye, tuple(at), style="--")
        out = np.radians(2.0 * normal - np.degrees(np.arctan2(eye[1] - at[1], eye[0] - at[0])))
        ends.append(at)
        outs.append(np.array([np.cos(out), np.sin(out)]))
    # Where the two rays, taken back, meet behind the mirror: the angle's corner.
    steps = np.linalg.solve(np.stack([outs[0], -outs[1]], axis=1), ends[1] - ends[0])
    corner = ends[0] + steps[0] * outs[0]
    for at, out in zip(ends, outs, strict=True):
        room = (22.2 - at[1]) / out[1] if out[1] > 0 else (0.8 - at[1]) / out[1]
        s.line(tuple(corner), tuple(at), colour=SOFT, style=":")
        s.arrow(tuple(at), tuple(at + min(room, 9.0) * out), MARKED)
    low, high = (float(np.degrees(np.arctan2(out[1], out[0]))) for out in outs)
    s.angle((float(corner[0]), float(corner[1])), 9.0, low, high)
    s.eye(*eye, "eye")
    s.text(35.4, 21.5, text, MARKED, align="right")


def two_eyes_on_horizon(s: Sheet, text: str, left: bool, right: bool) -> None:
    """In plan: what each eye is shown of the horizon, the host vehicle beside it."""
    s.box(22.0, 1.0, 8.0, 14.0, GROUND)
    s.text(26.0, 3.2, "vehicle")
    s.line((18.0, 16.2), (21.6, 17.6), wide=2.4)
    s.eye(25.2, 15.9)
    s.eye(26.8, 15.9)
    if left:
        s.wedge((19.5, 16.8), 15.0, 212.0, 256.0)
    if right:
        s.wedge((20.1, 17.0), 15.0, 206.0, 250.0, MARKED if not left else "#6f9ccb")
    s.line((19.8, 16.9), (19.8 + 15 * np.cos(np.radians(209)), 16.9 + 15 * np.sin(np.radians(209))), style=":")
    s.line((21.7, 16.0), (21.7, 1.0), style=":")
    s.text(9.5, 20.5, text, MARKED)
    s.text(29.5, 17.5, "eyes", align="left")


def road_plan(s: Sheet) -> None:
    """Seen from above, driving upwards: host vehicle at the right, the lane beside, what the mirror shows."""
    s.area((3, 0.5), (33, 0.5), (33, 23.5), (3, 23.5))
    s.line((19, 0.5), (19, 23.5), colour="white", style="--", wide=2.0)
    s.line((8, 0.5), (8, 23.5), colour="white", style="--", wide=2.0)
    s.box(21.0, 13.0, 6.0, 9.0, "white")
    s.eye(23.0, 19.0)
    s.text(30.0, 21.0, "host")


def picture_pair(s: Sheet, wide: float, high: float, mark: str, where: str) -> None:
    """One far thing as a flat mirror shows it, and as this one does."""
    s.box(3.0, 7.0, 12.0, 10.0, "#f7f9fc")
    s.text(9.0, 4.6, "flat mirror")
    s.box(22.0, 12.0 - 5.0 * high, 12.0 * wide, 10.0 * high, GROUND, MARKED)
    s.text(22.0 + 6.0 * wide, 4.6, "this mirror")
    s.text(22.0 + 6.0 * wide, 2.6, where, MARKED)
    if mark in ("wide", "ratio"):
        s.size((22.0, 12.0 + 5.0 * high + 1.0), (22.0 + 12.0 * wide, 12.0 + 5.0 * high + 1.0), "$e_h$", (0, 1.3))
        s.size((3.0, 18.2), (15.0, 18.2), "flat", (0, 1.3))
    if mark in ("high", "ratio"):
        x = 22.0 + 12.0 * wide + 1.0
        s.size((x, 12.0 - 5.0 * high), (x, 12.0 + 5.0 * high), "$e_v$", (1.5, 0))
        s.size((16.0, 7.0), (16.0, 17.0), "flat", (2.0, 0))


def lane_image(s: Sheet, from_x: float, tangent: bool = True) -> None:
    """The image of a straight lane across the face, and its tangent at from_x."""
    mirror_face(s)
    x = np.linspace(6.0, from_x, 60)
    u = (from_x - x) / 20.0
    y = 17.5 - 5.0 * u - 7.0 * u**2
    s.curve(x, y, wide=1.8)
    if tangent:
        s.line((from_x, 17.5), (6.0, 17.5 - 5.0 * (from_x - 6.0) / 20.0), style="--")


def grid(s: Sheet, bend: float) -> None:
    """A grid of directions as it is shown, beside the affine map that fits best."""
    n = np.linspace(-1.0, 1.0, 40)
    for k in np.linspace(-1.0, 1.0, 6):
        s.curve(13 + 9.5 * n, 12 + 8.5 * (k + 0 * n), colour=SOFT, style="--", wide=0.8)
        s.curve(13 + 9.5 * (k + 0 * n), 12 + 8.5 * n, colour=SOFT, style="--", wide=0.8)
        s.curve(13 + 9.5 * (n + bend * n**2 * 0.4 - bend * 0.15), 12 + 8.5 * (k + bend * k * n * 0.3))
        s.curve(13 + 9.5 * (k + bend * k**2 * 0.4 - bend * 0.15 + 0 * n), 12 + 8.5 * (n + bend * n * k * 0.3))


# ---- a drawing each

def yaw(s: Sheet) -> None:
    s.text(12.0, 22.0, "in plan; ahead is up")
    s.box(24.0, 2.0, 8.0, 18.0, GROUND)
    s.line((8, 14), (20, 14), style="--")
    s.line((8.6, 16.4), (19.6, 11.6), wide=2.4)
    s.arrow((14.0, 14.0), (14.0, 3.5))
    s.arrow((14.0, 14.0), (14.0 + 10.5 * np.sin(0.41), 14.0 - 10.5 * np.cos(0.41)), MARKED)
    s.angle((14.0, 14.0), 8.0, 270.0, 293.5, "yaw")
    s.text(10.0, 3.6, "rearward")


def pitch(s: Sheet) -> None:
    s.text(10.0, 22.0, "from the side")
    s.line((10, 4), (10, 19), style="--")
    s.line((12.4, 4.6), (7.6, 18.4), wide=2.4)
    s.arrow((10, 11.5), (24, 11.5))
    s.arrow((10, 11.5), (23.4, 16.2), MARKED)
    s.angle((10, 11.5), 10.0, 0.0, 19.3, "pitch")


def flank_share(s: Sheet) -> None:
    mirror_face(s)
    s.box(21.5, 3.0, 4.5, 17.0, SOFT, "none")
    s.line((6, 13), (26, 13), style=":")
    s.text(11.0, 14.0, "horizon")
    s.text(23.7, 6.0, "own\nflank")
    s.size((21.5, 13.0), (26.0, 13.0), "", (0, 0))
    s.size((6.0, 1.9), (26.0, 1.9), "width = 1", (0, -1.1))
    s.text(29.5, 13.0, "share", MARKED)


def horizon_share(s: Sheet) -> None:
    mirror_face(s)
    s.line((6, 13.2), (26, 13.2), style=":")
    s.line((16, 3), (16, 20), style=":", colour=SOFT)
    s.size((16, 3.0), (16, 13.2), "share", (2.6, 0))
    s.size((28, 3.0), (28, 20.0), "height = 1", (3.8, 0))


def above_horizon(s: Sheet) -> None:
    s.text(10.0, 22.0, "from the side")
    s.line((9, 5), (8.2, 17), wide=2.4)
    s.eye(22, 13.5, "eye")
    s.line((22, 13.5), (8.2, 17), style="--")
    s.line((8.2, 17), (32, 17), style=":")
    s.arrow((8.2, 17), (32, 21.5), MARKED)
    s.angle((8.2, 17), 19.0, 0.0, 10.7, "")
    s.text(31.0, 18.6, "angle", MARKED)


def edges_between(s: Sheet) -> None:
    field(s, (27.0, 6.5), False, "between the rays\nat the two edges")
    s.axes.plot([26.2, 27.8], [5.9, 7.1], "o", color=SOFT, markersize=3.5)
    s.text(31.4, 6.5, "the middle\nof two")


def upright(s: Sheet) -> None:
    s.text(10.0, 22.0, "from the side")
    s.line((9, 6), (8.2, 18), wide=2.4)
    s.area((8.6, 12), (33, 19), (33, 6), colour=SOFT)
    s.line((8.6, 12), (33, 12), style=":")
    s.angle((8.6, 12), 17.0, -14.0, 16.0, "")
    s.text(30.0, 21.0, "elevations", MARKED)
    s.eye(20, 15.5, "")


def lane_paper(s: Sheet) -> None:
    lane_image(s, 26.0)
    s.size((28.0, 17.5), (28.0, 5.5), "Δy curve", (3.4, -2.4))
    s.size((4.6, 17.5), (4.6, 12.5), "Δy\nline", (-2.4, 0))
    s.line((26, 17.5), (28.6, 17.5), style=":")
    s.line((6, 5.5), (28.6, 5.5), style=":", colour=SOFT)


def lane_road(s: Sheet) -> None:
    lane_image(s, 20.0)
    s.axes.plot(20.0, 17.5, "o", color=MARKED, markersize=4)
    s.text(20.0, 19.0, "vanishing point", MARKED)
    s.size((28.0, 17.5), (28.0, 10.6), "Δy curve", (3.6, 0))
    s.size((4.6, 17.5), (4.6, 14.0), "Δy\nline", (-2.4, 0))


def lane_bow(s: Sheet) -> None:
    lane_image(s, 26.0, tangent=False)
    s.line((26, 17.5), (6, 5.5), colour=INK, style="--")
    s.text(19.5, 8.0, "great circle\nthrough its ends")
    s.size((16.9, 12.0), (15.6, 14.2), "", (0, 0))
    s.text(13.4, 15.2, "bow", MARKED)


def column(s: Sheet, flat: bool) -> None:
    mirror_face(s)
    s.line((15, 4), (15, 19), style="--")
    u = np.linspace(0.0, 1.0, 40)
    s.curve(13.4 + 4.6 * u + 1.4 * u * (1 - u), 4.5 + 13.5 * u, wide=1.8)
    s.line((13.4, 4.5), (18.0, 18.0), colour=MARKED, style=":")
    if flat:
        s.line((14.2, 4.3), (16.4, 18.2), colour=SOFT, wide=1.8)
        s.text(12.2, 16.6, "flat,\ntangent", SOFT)
        s.angle((14.0, 4.4), 12.6, 71.5, 81.0, "")
    else:
        s.angle((14.0, 4.4), 12.6, 71.5, 85.5, "")
    s.text(20.5, 18.4, "tilt", MARKED)
    s.text(27.0 + 4.0, 4.5, "vertical: – –")


def distortion_rms(s: Sheet) -> None:
    grid(s, 0.55)
    s.text(30.5, 12.0, "RMS of all\nnodes", MARKED)


def distortion_max(s: Sheet) -> None:
    grid(s, 0.55)
    s.arrow((3.5, 20.5), (4.8, 19.1), MARKED)
    s.text(30.5, 12.0, "the farthest\nnode", MARKED)


def disparity(s: Sheet) -> None:
    s.text(9.5, 21.0, "left eye")
    s.text(26.5, 21.0, "right eye")
    s.box(4.0, 8.0, 9.0, 9.0, GROUND)
    s.box(21.0, 8.0, 11.0, 9.0, GROUND)
    s.size((4.0, 6.2), (13.0, 6.2), "$M_{left}$", (0, -1.8))
    s.size((21.0, 6.2), (32.0, 6.2), "$M_{right}$", (0, -1.8))


def disparity_rate(s: Sheet) -> None:
    x = np.linspace(4.0, 32.0, 80)
    y = 15.0 - 9.0 * np.exp(-((x - 12.0) / 4.0) ** 2)
    s.curve(x, y, wide=1.8)
    s.line((12.2, 3.5), (18.2, 16.9), colour=MARKED)
    s.arrow((4, 3), (33, 3))
    s.arrow((4, 3), (4, 21))
    s.text(31.0, 1.6, "x")
    s.text(8.0, 20.6, "disparity, %")
    s.text(22.5, 10.0, "steepest slope", MARKED)


def nearest_ground(s: Sheet) -> None:
    road_plan(s)
    s.area((20.4, 9.0), (20.4, 0.5), (4.0, 0.5), (10.0, 5.0), colour=SOFT)
    s.line((20.6, 22), (20.6, 0.5), colour=MARKED, style=":")
    s.line((23, 19), (14.0, 19), colour=SOFT, style=":")
    s.size((17.0, 19.0), (17.0, 9.0), "nearest", (-3.0, 0))
    s.line((15.5, 9.0), (20.6, 9.0), colour=MARKED, style=":")


def hidden_car(s: Sheet) -> None:
    road_plan(s)
    s.area((19.5, 5.0), (19.5, 0.5), (4.0, 0.5), (9.0, 3.0), colour=SOFT)
    s.box(11.5, 6.4, 4.0, 8.6, "white", MARKED)
    s.size((10.2, 6.4), (10.2, 15.0), "longest", (-3.2, 0))
    s.text(13.5, 3.0, "seen")
    s.line((23, 19), (8, 20.2), style=":")
    s.text(12.5, 21.4, "direct view")


def ground_width(s: Sheet, eyes: str = "") -> None:
    road_plan(s)
    s.area((20.4, 9.0), (20.4, 0.5), (4.0, 0.5), (10.0, 5.0), colour=SOFT)
    s.size((7.4, 3.0), (20.4, 3.0), "width", (0, 1.4))
    s.size((29.0, 19.0), (29.0, 3.0), "20 m", (2.4, 0))
    s.text(13.4, 10.5, eyes)


def blind_length(s: Sheet, where: str = "") -> None:
    blind_zone(s, where)
    s.size((16.6, 6.9), (16.6, 19.5), "length", (-2.8, -2.6))


def blind_area(s: Sheet, where: str = "") -> None:
    blind_zone(s, where)
    s.text(13.4, 10.6, "area", MARKED)


def blind_zone(s: Sheet, where: str) -> None:
    road_plan(s)
    s.area((8, 20.2), (19, 19.3), (19, 8.0), (8, 2.8), colour="#f0c9b0")
    s.line((23, 19), (8, 20.2), style=":")
    s.text(13.0, 21.6, "direct view")
    s.text(12.5, 1.8, "shown by the mirror")
    s.text(12.6, 14.6, where)


def angular_size(s: Sheet, side: str = "size", flat: bool = False) -> None:
    """A car's image, as far behind the mirror as it seems, and the angle under which the eye has it."""
    half, far = (3.2, 31.0) if flat else (1.6, 24.0)
    s.eye(4, 11, "eye")
    bend = np.linspace(-1.0, 1.0, 40)
    s.curve(15.0 + (0.0 if flat else 1.4) * bend**2, 11 + 8.0 * bend, wide=2.2)
    s.text(15.5, 21.0, "flat mirror" if flat else "mirror")
    s.box(far, 11 - half, 3.4, 2 * half, GROUND, MARKED)
    s.line((4, 11), (far, 11 + half), style="--")
    s.line((4, 11), (far, 11 - half), style="--")
    turn = float(np.degrees(np.arctan2(half, far - 4.0)))
    s.angle((4, 11), 8.5, -turn, turn)
    s.text(9.0, 14.0, side, MARKED)
    s.text(29.0, 5.4, "image of a car,\n20 m behind")


def anything(s: Sheet) -> None:
    mirror_face(s)
    s.eye(31, 10, "eye")


def wide(wide_: float, high: float, mark: str, where: str) -> Draw:
    return lambda s: picture_pair(s, wide_, high, mark, where)


DRAWINGS: dict[str, Draw] = {
    "yaw_deg": yaw, "pitch_deg": pitch, "flank_share": flank_share, "horizon_share": horizon_share,
    "above_horizon_deg": above_horizon,
    "h_fov_section_deg": lambda s: field(s, (29.0, 11.0), False, "between the rays,\neye on the axis"),
    "h_fov_traced_deg": lambda s: field(s, (27.0, 6.5), False, "between the rays,\neye where it sits"),
    "v_fov_left_section_deg": lambda s: field(s, (29.0, 11.0), True, "between the rays,\neye on the axis"),
    "v_fov_left_traced_deg": lambda s: field(s, (28.0, 13.0), True, "between the rays,\neye where it sits"),
    "h_fov_between_edges_deg": edges_between,
    "horizon_left_deg": lambda s: two_eyes_on_horizon(s, "left eye", True, False),
    "horizon_right_deg": lambda s: two_eyes_on_horizon(s, "right eye", False, True),
    "horizon_either_deg": lambda s: two_eyes_on_horizon(s, "one of the two, or both", True, True),
    "horizon_both_deg": lambda s: two_eyes_on_horizon(s, "where the two overlap", True, True),
    "upright_either_deg": upright,
    "magnification_middle": wide(0.42, 0.5, "wide", "in the middle"),
    "magnification_least": wide(0.25, 0.5, "wide", "the least"),
    "magnification_vertical_middle": wide(0.42, 0.5, "high", "in the middle"),
    "magnification_ratio_least": wide(0.25, 0.6, "ratio", "the slimmest"),
    "lane_straightness_percent": lane_paper, "lane_straightness_road_percent": lane_road, "lane_bow_arcmin": lane_bow,
    "column_tilt_arcmin": lambda s: column(s, False), "column_tilt_by_curvature_arcmin": lambda s: column(s, True),
    "grid_distortion_rms_arcmin": distortion_rms, "grid_distortion_max_arcmin": distortion_max,
    "disparity_max_percent": disparity, "disparity_max_rate_percent_per_mm": disparity_rate,
    "ground_nearest_m": nearest_ground, "hidden_car_longest_m": hidden_car,
}
# Of measures that have no drawing of their own.
OF_GROUP: dict[str, Draw] = {
    "Aim": flank_share, "Field of view": edges_between, "Size": angular_size, "Straightness": lane_bow,
    "Two eyes": disparity, "Ground and blind zone": ground_width, "Other": anything,
}

def of_family(name: str) -> Draw | None:
    """Of measures of which there is one for each distance or height that a scene asks about, by their names."""
    if name.startswith("vehicle_"):
        return lambda s: angular_size(s, "width" if "width" in name else "height", "flat" in name)
    if name.startswith("ground_width_"):
        return lambda s: ground_width(s, "by either eye" if "either" in name else "by both eyes")
    for start, draw in (("blind_length", blind_length), ("blind_area", blind_area)):
        if name.startswith(start):
            return partial(draw, where="at a height" if "_at_" in name else "on the ground")
    return None
