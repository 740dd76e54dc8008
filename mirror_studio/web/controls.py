"""The specification's keys in, the page's controls out: label, unit, range and what each is shown with."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

from mirror_studio.web.protocol import ViewSettings

Kind = Literal["number", "choice", "text", "flag"]


@dataclass(frozen=True, slots=True)
class Control:
    """An input of the page for one key of a specification.

    low, high : ends of the slider; a number may be entered beyond them, as far as the specification takes it.
    least, most : what a number of a look may be; None where the specification judges.
    step : what an arrow key changes it by.   digits : shown after the point.   choices : values with their words.
    law : the laws that have this key.   optional : may be left out, with `default` to begin with when it is put in.
    part : which entry of a list.
    """

    key: str
    label: str
    kind: Kind = "number"
    unit: str = ""
    low: float | None = None
    high: float | None = None
    step: float = 1.0
    digits: int = 3
    choices: tuple[tuple[Any, str], ...] = ()
    law: tuple[str, ...] = ()
    optional: bool = False
    default: Any = None
    help: str = ""
    least: float | None = None
    most: float | None = None


@dataclass(frozen=True, slots=True)
class Group:
    """Controls under one heading.   view : the view that they are there for; "" for all."""

    title: str
    controls: tuple[Control, ...]
    open: bool = False
    view: Literal["", "road"] = ""


LAWS = (("constant", "constant"), ("linear", "linear"), ("power", "power"), ("zones", "zones"), ("table", "table"),
        ("expression", "formula"))
ENDS = ("linear", "power", "zones")  # the laws between two radii


def _radius(key: str, label: str, law: tuple[str, ...], help_: str = "") -> Control:
    return Control(key, label, unit="mm", low=20.0, high=3000.0, step=5.0, digits=1, law=law, help=help_)


def _law(section: str, axis: str) -> tuple[Control, ...]:
    horizontal = section == "horizontal"
    matched = ("power", "zones") if horizontal else ()
    controls = (
        Control(f"{section}.law", "Law", "choice", choices=LAWS),
        _radius(f"{section}.radius_mm", f"{axis} everywhere", ("constant",)),
        _radius(f"{section}.right_mm", f"{axis} right", ENDS, "At the right edge, on the driver's side"),
        _radius(f"{section}.left_mm", f"{axis} left", ENDS, "At the left edge, outboard"),
        Control(f"{section}.exponent", "Exponent", low=0.2, high=8.0, step=0.05, law=("power",)),
        Control(f"{section}.blend_from", "Blend from t", low=0.0, high=1.0, step=0.01, law=("zones",),
                help="t runs from 0 at the right edge to 1 at the left"),
        Control(f"{section}.blend_to", "Blend to t", low=0.0, high=1.0, step=0.01, law=("zones",)),
        Control(f"{section}.blend", "Blend", "choice", choices=(("smooth", "smooth"), ("linear", "linear")), law=("zones",)),
        Control(f"{section}.radius", "R =", "text", law=("expression",), optional=True, default="1250",
                help="A formula in t and x (mm)"),
        Control(f"{section}.curvature", "or κ =", "text", law=("expression",), optional=True, default="1/1250",
                help="A formula in t and x (mm), per mm"),
    )
    if not horizontal:
        return controls
    return (*controls,
            Control("horizontal.match.sphere_mm", "Sphere", unit="mm", low=300.0, high=2000.0, step=5.0,
                    digits=1, law=matched, help="The open number is solved so that the section H-FOV is that of this sphere"),
            Control("horizontal.match.h_fov_deg", "H-FOV", unit="°", low=10.0, high=90.0, step=0.1, law=matched,
                    help="The open number is solved so that the section H-FOV is this"),
            Control("horizontal.level_at", "Level at", "choice", unit="mm", low=-115.0, high=115.0, step=1.0, digits=1,
                    choices=(("centre", "centre"), ("right", "right edge"), ("left", "left edge"), ("number", "x ="))),
            Control("horizontal.span_mm.0", "t = 1 at x", unit="mm", low=-200.0, high=200.0, digits=1, optional=True,
                    default=-115.0),
            Control("horizontal.span_mm.1", "t = 0 at x", unit="mm", low=-200.0, high=200.0, digits=1, optional=True,
                    default=115.0))


def _length(key: str, label: str, low: float, high: float, step: float = 1.0, **more: Any) -> Control:
    return Control(key, label, unit="mm", low=low, high=high, step=step, digits=2, **more)


def _metres(key: str, label: str, low: float, high: float, help_: str) -> Control:
    return Control(key, label, unit="m", low=low, high=high, step=0.01, help=help_)


GROUPS = (
    Group("Aim and eyes on the road", (
        Control("look.hand", "Mirror", "choice", choices=(("left", "left-hand"), ("right", "right-hand")),
                help="The laws describe the left mirror; the right one is its reflection"),
        Control("look.flank_share", "Own flank", low=0.0, high=0.5, step=0.01,
                help="Share of the mirror's width, from its inboard edge, that the own flank takes on the horizon's row"),
        Control("look.horizon_share", "Horizon at", low=0.2, high=0.9, step=0.01,
                help="Share of the mirror's height, from its lower edge, at which the horizon lies in the middle of the width"),
        _metres("look.eye_x_m", "Eyes rearward", -0.3, 0.6, "Of where the scene has them; the mirror stays"),
        _metres("look.eye_y_m", "Eyes to the right", -0.8, 0.8, "Of the vehicle's middle"),
        _metres("look.eye_z_m", "Eyes above road", 1.0, 3.0, "The middle between the two ocular points"),
        Control("look.eyes_apart_m", "Eyes apart", unit="m", low=0.0, high=0.1, step=0.001, digits=4,
                help="UN Regulation 46 has 0.065 m"),
    ), True, "road"),
    Group("Horizontal radius Rx", _law("horizontal", "Rx"), True),
    Group("Vertical radius Ry", _law("vertical", "Ry"), True),
    Group("Eye and pose", (
        _length("eye.distance_mm", "Eye to mirror", 300.0, 3000.0, 5.0),
        Control("eye.aligned", "Eye in line with", "choice",
                choices=(("right", "right edge"), ("centre", "centre"), ("left", "left edge"))),
        Control("look.yaw_deg", "Yaw", unit="°", low=-20.0, high=20.0, step=0.1,
                help="Turns the face towards the driver's side, before the picture; on the road the aim does"),
        Control("look.pitch_deg", "Pitch", unit="°", low=-20.0, high=20.0, step=0.1,
                help="Turns the face up, before the picture; on the road the aim does"),
    )),
    Group("Outline and blank", (
        _length("outline.width_mm", "Width", 20.0, 600.0),
        _length("outline.left_height_mm", "Height, left", 20.0, 600.0),
        _length("outline.right_height_mm", "Height, right", 20.0, 600.0),
        _length("outline.corner_radius_mm", "Corner radius", 0.0, 150.0),
        _length("blank.width_mm", "Blank width", 20.0, 700.0),
        _length("blank.height_mm", "Blank height", 20.0, 700.0),
    )),
    Group("Glass", (
        _length("glass.thickness_mm", "Thickness", 0.5, 12.0, 0.1),
        Control("glass.reflecting", "Reflects from", "choice", choices=(("front", "the front"), ("back", "the back"))),
        Control("glass.index", "Refractive index", low=1.0, high=2.0, step=0.005),
    )),
    Group("Scene", (
        Control("scene.image", "Picture", "text"),
        _length("scene.distance_mm", "Plane behind eye", 1000.0, 100_000.0, 100.0),
        _length("scene.width_mm", "Width on plane", 1000.0, 100_000.0, 100.0),
        _length("scene.centre_mm.0", "Centre X", -20_000.0, 20_000.0, 50.0),
        _length("scene.centre_mm.1", "Centre Y", -20_000.0, 20_000.0, 50.0),
        _length("scene.lane.x0_mm", "Lane X₀", -10_000.0, 10_000.0, 50.0),
        _length("scene.lane.y0_mm", "Lane Y₀", -10_000.0, 10_000.0, 50.0),
        Control("scene.lane.slope", "Lane slope", low=-3.0, high=3.0, step=0.01),
    )),
    Group("Surface and limits", (
        Control("surface.method", "Method", "choice",
                choices=(("decoupled", "decoupled (the paper's)"), ("faithful", "faithful"))),
        Control("surface.integration", "Integration", "choice",
                choices=(("quadrature", "quadrature"), ("euler", "Euler (the paper's)"), ("rk4", "Runge–Kutta 4"))),
        _length("surface.step_mm", "Integration step", 0.1, 20.0, 0.1, optional=True, default=1.0),
        Control("surface.fit", "Fit", "choice",
                choices=(("collocation", "collocation"), ("occt-interpolate", "kernel, interpolating"),
                         ("occt-approximate", "kernel, approximating"))),
        Control("surface.degree", "Degree", "choice",
                choices=(("auto", "automatic"), *((n, str(n)) for n in range(3, 10)))),
        Control("surface.spans", "Spans", "choice", choices=(("auto", "automatic"), ("number", "nx × ny"))),
        Control("surface.position_tolerance_mm", "Position tol.", unit="mm", low=1e-7, high=1e-3, step=1e-6, digits=7),
        Control("surface.curvature_tolerance_percent", "Curvature tol.", unit="%", low=1e-4, high=1.0, step=1e-3, digits=4),
        Control("limits.curvature_percent", "Part's limit", unit="%", low=0.1, high=20.0, step=0.1, optional=True,
                default=5.0, help="The limit band of the laws, and what the built part must meet"),
    )),
    Group("Part", (
        Control("part.number", "Number", "text", optional=True, help="Of the drawing: “none stated” without one"),
        Control("part.revision", "Revision", "text", optional=True),
        Control("part.hand", "Hand", "choice", choices=(("left", "left-hand"), ("right", "right-hand")),
                help="What the report says; the laws and files stay as they are"),
        Control("part.title", "Title", "text", optional=True),
    )),
    Group("Files", (
        Control("name", "Name", "text"),
        Control("view.width_px", "Picture width", unit="px", low=320.0, high=4096.0, step=16.0, digits=0),
        _length("export.stl_deflection_mm", "STL deflection", 0.001, 1.0, 0.001),
        _length("export.surface_margin_mm", "Sheet margin", 0.0, 50.0),
    )),
)


def controls() -> list[dict[str, Any]]:
    """All groups as JSON holds them."""
    look = ViewSettings.model_json_schema()["properties"]
    return [asdict(replace(group, controls=tuple(_bounded(control, look) for control in group.controls))) for group in GROUPS]


def _bounded(control: Control, look: dict[str, Any]) -> Control:
    """With the limits that a message's look has for the key; one step inside where the limit itself is refused."""
    section, _, name = control.key.partition(".")
    if section != "look" or control.kind != "number":
        return control
    limits = look[name]
    least = limits["minimum"] if "minimum" in limits else limits["exclusiveMinimum"] + control.step
    return replace(control, least=least, most=limits["maximum"])
