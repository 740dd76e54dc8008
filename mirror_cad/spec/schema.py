"""What a mirror is asked to be: each section of a specification and its keys, with unit, range and default."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal, get_args

from pydantic import (
    ConfigDict,
    Field,
    SerializationInfo,
    SerializeAsAny,
    SerializerFunctionWrapHandler,
    ValidationError,
    ValidationInfo,
    field_serializer,
    field_validator,
    model_validator,
)
from pydantic.functional_validators import PlainValidator
from pydantic_core import InitErrorDetails

from mirror_cad.eyes import EYE_DISTANCE_MM
from mirror_cad.keys import ELSEWHERE, AsTuple, Coordinate, Length, Number, Section, Shown
from mirror_cad.laws import Law
from mirror_cad.laws.unstated import Unstated
from mirror_cad.limits import limit_units
from mirror_cad.outline.options import AS_DRAWN, FILE_JOIN_TOLERANCE_MM, LARGEST_JOIN_MM, FileOptions
from mirror_cad.spec.law_section import horizontal_law, vertical_law
from mirror_cad.spec.rules_section import RulesSection
from mirror_cad.spec.target import Target

# Characters of a part's number or revision, and of its title: what a line of the report's head holds.
LONGEST_MARK, LONGEST_TITLE = 48, 100
LARGEST_LIMIT = 1e6  # degrees or percent: beyond anything that an angle or a lane can have


def _size(label: str, low: float, high: float, step: float = 1.0, start: float | None = None) -> Shown:
    return Shown(label, low, high, step, 2, start=start)


class Blank(Section):
    """The rectangle that the mirror is cut from."""

    width_mm: Annotated[Length, _size("Blank width", 20.0, 700.0)] = 250.0
    height_mm: Annotated[Length, _size("Blank height", 20.0, 700.0)] = 380.0


class OutlineSpec(Section):
    """A quadrilateral with tangent corner arcs, or a closed curve from a DXF or SVG file.

    layer, join_mm, loop : how the file is read, as `mirror_cad.outline.options.FileOptions` has it.
    """

    width_mm: Annotated[Length, _size("Width", 20.0, 600.0)] = 230.0
    left_height_mm: Annotated[Length, _size("Height, left", 20.0, 600.0)] = 270.0
    right_height_mm: Annotated[Length, _size("Height, right", 20.0, 600.0)] = 340.0
    corner_radius_mm: Annotated[Number, Field(ge=0, le=1e5), _size("Corner radius", 0.0, 150.0)] = 40.0
    file: Annotated[str | None, ELSEWHERE] = None
    layer: Annotated[Annotated[str, Field(min_length=1, max_length=255)] | None, ELSEWHERE] = None
    join_mm: Annotated[Annotated[Number, Field(ge=FILE_JOIN_TOLERANCE_MM, le=LARGEST_JOIN_MM)] | None, ELSEWHERE] = None
    loop: Annotated[Literal["only", "outermost"] | None, ELSEWHERE] = None

    @model_validator(mode="after")
    def _one_source(self) -> OutlineSpec:
        of_file = {"layer", "join_mm", "loop"}
        if self.file is None and (stray := sorted(self.model_fields_set & of_file)):
            raise ValueError(f"{', '.join(stray)} say how an outline file is read: give file too")
        others = sorted(self.model_fields_set - of_file - {"file"})
        if self.file is not None and others:
            raise ValueError(f"file and {', '.join(others)} cannot both be given: the file alone says the outline")
        return self

    @property
    def file_options(self) -> FileOptions:
        """How the file is read."""
        return FileOptions(self.layer, self.join_mm or AS_DRAWN.join_mm, self.loop or AS_DRAWN.loop)


class Glass(Section):
    """The plate: which of its two faces reflects, and so is the designed one; `index` is the glass's at the d line."""

    thickness_mm: Annotated[Number, Field(gt=0, le=1000), _size("Thickness", 0.5, 12.0, 0.1)] = 3.0
    reflecting: Annotated[Literal["front", "back"],
                          Shown("Reflects from", words=(("front", "the front"), ("back", "the back")))] = "front"
    index: Annotated[Number, Field(ge=1, le=3), Shown("Refractive index", 1.0, 2.0, 0.005)] = 1.52


_METHODS = Literal["decoupled", "faithful", "sphere", "view"]


class SurfaceSpec(Section):
    """How the surface is made, of the two laws or of a wanted view, and how closely."""

    method: Annotated[_METHODS, Shown("Method", words=(("decoupled", "decoupled (the paper's)"), ("faithful", "faithful"),
                                                       ("sphere", "sphere")))] = "decoupled"
    integration: Annotated[Literal["quadrature", "euler", "rk4"],
                           Shown("Integration", words=(("quadrature", "quadrature"), ("euler", "Euler (the paper's)"),
                                                       ("rk4", "Runge–Kutta 4")))] = "quadrature"
    step_mm: Annotated[Annotated[Number, Field(ge=1e-3, le=1000)] | None,
                       _size("Integration step", 0.1, 20.0, 0.1, start=1.0)] = None
    fit: Annotated[Literal["collocation", "occt-interpolate", "occt-approximate"],
                   Shown("Fit", words=(("collocation", "collocation"), ("occt-interpolate", "kernel, interpolating"),
                                       ("occt-approximate", "kernel, approximating")))] = "collocation"
    degree: Annotated[int | Literal["auto"], PlainValidator(lambda value: _degree(value)),
                      Shown("Degree", words=(("auto", "automatic"), *((n, str(n)) for n in range(3, 10))))] = "auto"
    spans: Annotated[tuple[int, int] | Literal["auto"], PlainValidator(lambda value: _spans(value)),
                     Shown("Spans", words=(("auto", "automatic"), ("number", "nx × ny")))] = "auto"
    position_tolerance_mm: Annotated[Number, Field(ge=1e-9, le=1), Shown("Position tol.", 1e-7, 1e-3, 1e-6, 7)] = 1e-5
    curvature_tolerance_percent: Annotated[Number, Field(ge=1e-6, le=100), Shown("Curvature tol.", 1e-4, 1.0, 1e-3, 4)] = 0.01

    @model_validator(mode="after")
    def _belonging(self) -> SurfaceSpec:
        if self.integration == "quadrature" and self.step_mm is not None:
            raise ValueError("step_mm belongs to integration = \"euler\" or \"rk4\"; quadrature chooses its own nodes")
        if self.integration != "quadrature" and self.step_mm is None:
            raise ValueError(f"integration = \"{self.integration}\" needs step_mm, the paper's h")
        if self.method in ("faithful", "sphere") and self.integration != "quadrature":
            why = "the faithful surface starts from the exact profile" if self.method == "faithful" else "a sphere has none"
            raise ValueError(f"integration = \"{self.integration}\" belongs to method = \"decoupled\": {why}")
        if self.method == "view" and (self.integration != "quadrature" or self.fit != "collocation"):
            raise ValueError("method = \"view\" solves for the B-spline itself: it has no integration and no fit of its own")
        if self.fit != "collocation" and (self.degree != "auto" or self.spans != "auto"):
            raise ValueError("degree and spans belong to fit = \"collocation\": the kernel's own routes choose theirs")
        return self


def _degree(value: object) -> int | str:
    if value == "auto" or (isinstance(value, int) and not isinstance(value, bool) and 3 <= value <= 9):
        return value
    raise ValueError("must be \"auto\" or a whole number from 3 to 9")


def _spans(value: object) -> tuple[int, int] | str:
    if value == "auto":
        return "auto"
    if isinstance(value, list | tuple) and len(value) == 2:
        nx, ny = value
        if all(isinstance(n, int) and not isinstance(n, bool) and 1 <= n <= 400 for n in (nx, ny)):
            return (nx, ny)
    raise ValueError("must be \"auto\" or two whole numbers from 1 to 400, [nx, ny]")


class PartSpec(Section):
    """What a drawing calls the mirror, and which of a pair it is.

    number, revision : “none stated” without one.   hand : the side of the vehicle. Laws, outline and eye are always those of
    the left-hand mirror, whose driver sits on its right; the files of a right-hand one hold its reflection in x = 0.
    transition_mm : x of the line that parts an aspheric part, outboard of it, from the main part: a curve in the STEP files and
    in the drawing, and what the rules of the road tell the two apart by.
    """

    number: Annotated[str | None, Shown("Number", help="Of the drawing: “none stated” without one")] = None
    revision: Annotated[str | None, Shown("Revision")] = None
    hand: Annotated[Literal["left", "right"],
                    Shown("Hand", words=(("left", "left-hand"), ("right", "right-hand")),
                          help="The files of a right-hand mirror are the reflection of what the laws say")] = "left"
    title: Annotated[str | None, Shown("Title")] = None
    transition_mm: Annotated[Coordinate | None,
                             Shown("Transition line", -300.0, 300.0, 1.0, 2, start=0.0,
                                   help="x of the line beyond which, outboard, the aspheric part lies")] = None

    @field_validator("number", "revision", "title", mode="after")
    @classmethod
    def _one_line(cls, value: str | None, info: ValidationInfo) -> str | None:
        most = LONGEST_TITLE if info.field_name == "title" else LONGEST_MARK
        if value is not None and not (value.isprintable() and value.strip() and len(value) <= most):
            raise ValueError(f"must be one line of 1 to {most} printable characters")
        return value


Ends = Annotated[tuple[float, float] | None, PlainValidator(lambda value: _ends(value))]


class Limits(Section):
    """What the part and its view must meet; nothing by default.

    curvature_percent : how far k1 and k2 may be off, ±.   The others are [least, most], −inf or inf where a side is free:
    h_fov_deg, v_fov_left_deg : fields of view of the sections, as table 1 has them.   lane_straightness_percent : as traced.
    Any registered figure may be limited by its name as well (`mirror_cad.limits`; `mirror-cad measures` lists them).
    """

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Ends]

    curvature_percent: Annotated[Annotated[Number, Field(gt=0, le=1000)] | None,
                                 Shown("Part's limit", 0.1, 20.0, 0.1, start=5.0,
                                       help="The limit band of the laws, and what the built part must meet")] = None
    h_fov_deg: Annotated[Ends, ELSEWHERE] = None
    v_fov_left_deg: Annotated[Ends, ELSEWHERE] = None
    lane_straightness_percent: Annotated[Ends, ELSEWHERE] = None

    @model_validator(mode="before")
    @classmethod
    def _known_figures(cls, section: object) -> object:
        """Refuse a name that no figure has: as any other unknown key."""
        if isinstance(section, Mapping):
            unknown = [str(key) for key in section if key not in cls.model_fields and key not in limit_units()]
            if unknown:
                raise ValidationError.from_exception_data("limits", [
                    InitErrorDetails(type="extra_forbidden", loc=(key,), input=section[key]) for key in unknown])
        return section

    def by_name(self) -> dict[str, tuple[float, float]]:
        """The least and the most that is asked of registered figures."""
        return {name: ends for name, ends in (self.__pydantic_extra__ or {}).items() if ends is not None}


def _ends(value: object) -> tuple[float, float] | None:
    if value is None:
        return None
    if isinstance(value, list | tuple) and len(value) == 2 and all(
            isinstance(end, int | float) and not isinstance(end, bool)
            and (-LARGEST_LIMIT <= end <= LARGEST_LIMIT or end == free)
            for end, free in zip(value, (-math.inf, math.inf), strict=True)):
        least, most = float(value[0]), float(value[1])
        if least <= most:
            return least, most
        raise ValueError("the first number, the least, must not be above the second, the most")
    raise ValueError(f"must be two numbers of at most {LARGEST_LIMIT:g} in size, [least, most], with -inf for no least or inf "
                     "for no most")


class Eye(Section):
    """The driver's eye: its distance from the centre of the mirror surface, and the edge that it is in line with."""

    distance_mm: Annotated[Length, _size("Eye to mirror", 300.0, 3000.0, 5.0)] = EYE_DISTANCE_MM
    aligned: Annotated[Literal["right", "centre", "left"],
                       Shown("Eye in line with", words=(("right", "right edge"), ("centre", "centre"), ("left", "left edge"))),
                       ] = "right"


class Lane(Section):
    """Y = y0 + slope·(X − x0) in the reference plane."""

    x0_mm: Annotated[Coordinate, _size("Lane X₀", -10_000.0, 10_000.0, 50.0)] = 0.0
    y0_mm: Annotated[Coordinate, _size("Lane Y₀", -10_000.0, 10_000.0, 50.0)] = 2400.0
    slope: Annotated[Number, Field(ge=-1e3, le=1e3), Shown("Lane slope", -3.0, 3.0, 0.01)] = 0.6


class SceneSpec(Section):
    """The picture on the reference plane behind the eye, and the lane on that plane."""

    image: Annotated[str, Shown("Picture")] = "road"
    distance_mm: Annotated[Number, Field(gt=0, le=1e6), _size("Plane behind eye", 1000.0, 100_000.0, 100.0)] = 8200.0
    width_mm: Annotated[Number, Field(gt=0, le=1e6), _size("Width on plane", 1000.0, 100_000.0, 100.0)] = 9000.0
    centre_mm: Annotated[tuple[Coordinate, Coordinate], AsTuple,
                         _size("Centre X, Centre Y", -20_000.0, 20_000.0, 50.0)] = (-2300.0, 0.0)
    lane: Lane = Lane()


class View(Section):
    """The driver's picture."""

    width_px: Annotated[int, Field(ge=16, le=4096), Shown("Picture width", 320.0, 4096.0, 16.0, 0)] = 1280


class Export(Section):
    """How the files of the part are written."""

    stl_deflection_mm: Annotated[Number, Field(ge=1e-3, le=10), _size("STL deflection", 0.001, 1.0, 0.001)] = 0.01
    surface_margin_mm: Annotated[Number, Field(ge=0, le=1000), _size("Sheet margin", 0.0, 50.0)] = 15.0


class MirrorSpec(Section):
    """One mirror, frozen. Lengths in mm, angles in degrees, x right, y up, z towards the driver.

    Attributes
    ----------
    name : str
        What its files are called.
    horizontal, vertical : Law
        Rx and Ry over x, each one of `mirror_cad.laws`; `Unstated` where method = "view" leaves them out.
    target : Target or None
        The wanted view, of method = "view".
    """

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$"), Shown("Name")] = "mirror"
    horizontal: Annotated[SerializeAsAny[Law], PlainValidator(horizontal_law)]
    vertical: Annotated[SerializeAsAny[Law], PlainValidator(vertical_law)]
    blank: Blank = Blank()
    outline: OutlineSpec = OutlineSpec()
    glass: Glass = Glass()
    surface: SurfaceSpec = SurfaceSpec()
    target: Annotated[Target | None, ELSEWHERE] = None
    part: PartSpec = PartSpec()
    rules: Annotated[RulesSection | None, ELSEWHERE] = None
    limits: Limits = Limits()
    eye: Eye = Eye()
    scene: SceneSpec = SceneSpec()
    view: View = View()
    export: Export = Export()

    @model_validator(mode="before")
    @classmethod
    def _without_laws(cls, content: object) -> object:
        """Where the surface comes from a view, laws may be left out."""
        if not isinstance(content, Mapping):
            return content
        surface = content.get("surface")
        method = surface.get("method") if isinstance(surface, Mapping) else getattr(surface, "method", None)
        meant = content.get("target") is not None and method not in (None, *get_args(_METHODS))  # a slip is told once
        return content if method != "view" and not meant else {"horizontal": Unstated(), "vertical": Unstated(), **content}

    @property
    def has_laws(self) -> bool:
        """Whether the surface is made by the two laws."""
        return self.surface.method != "view"

    @field_serializer("vertical", mode="wrap")
    def _own_keys(self, law: Law, handler: SerializerFunctionWrapHandler, info: SerializationInfo) -> dict[str, object]:
        content: dict[str, object] = handler(law)
        return {key: value for key, value in content.items() if key not in Law.horizontal_only}

    @field_validator("outline", mode="after")
    @classmethod
    def _outline_beside_the_spec(cls, section: OutlineSpec, info: ValidationInfo) -> OutlineSpec:
        """File names are relative to the specification's folder; here they become paths."""
        return section if section.file is None else section.model_copy(update={"file": _beside(section.file, info)})

    @field_validator("scene", mode="after")
    @classmethod
    def _picture_beside_the_spec(cls, section: SceneSpec, info: ValidationInfo) -> SceneSpec:
        return section if section.image == "road" else section.model_copy(update={"image": _beside(section.image, info)})

    @field_validator("rules", mode="after")
    @classmethod
    def _rule_beside_the_spec(cls, section: RulesSection | None, info: ValidationInfo) -> RulesSection | None:
        if section is None or not section.rule.endswith(".toml"):
            return section
        return section.model_copy(update={"rule": _beside(section.rule, info)})

    @model_validator(mode="after")
    def _fits(self) -> MirrorSpec:
        faults = self._faults_of_view()
        outline, blank = self.outline, self.blank
        if outline.file is None:
            if outline.width_mm > blank.width_mm:
                faults.append(f"outline.width_mm = {outline.width_mm:g} is wider than the blank "
                              f"(blank.width_mm = {blank.width_mm:g})")
            for key in ("left_height_mm", "right_height_mm"):
                if getattr(outline, key) > blank.height_mm:
                    faults.append(f"outline.{key} = {getattr(outline, key):g} is higher than the blank "
                                  f"(blank.height_mm = {blank.height_mm:g})")
        if self.surface.method == "sphere" and not self._of_one_radius():
            faults.append("surface.method = \"sphere\" needs two constant laws of one radius, but Rx is "
                          f"{self.horizontal.in_words()} and Ry is {self.vertical.in_words()}: give both law = \"constant\" "
                          "with the same radius_mm, or take method = \"decoupled\" or \"faithful\", which take any two laws")
        if self.surface.method == "sphere" and self.part.transition_mm is not None:
            faults.append(f"part.transition_mm = {self.part.transition_mm:g} marks where an aspheric part begins, and "
                          "surface.method = \"sphere\" makes none")
        if faults:
            raise ValueError("; ".join(faults))
        return self

    def _of_one_radius(self) -> bool:
        radius = self.horizontal.radius_everywhere_mm
        return radius is not None and radius == self.vertical.radius_everywhere_mm

    def _faults_of_view(self) -> list[str]:
        """What does not go with a wanted view, or without one."""
        if self.has_laws:
            return [] if self.target is None else [
                f"[target] belongs to surface.method = \"view\", and here it is \"{self.surface.method}\""]
        faults = []
        if self.target is None:
            faults.append("target: this section is required with surface.method = \"view\": projection, azimuth_deg, "
                          "elevation_deg")
        if self.limits.curvature_percent is not None:
            faults.append(f"limits.curvature_percent = {self.limits.curvature_percent:g} is held against curvature laws, and "
                          "surface.method = \"view\" has none: limit what is seen instead (h_fov_traced_deg, …)")
        if self.glass.reflecting == "back":
            faults.append("glass.reflecting = \"back\": a wanted view is solved for a mirror that reflects from its front")
        return faults


def _beside(name: str, info: ValidationInfo) -> str:
    return str(Path((info.context or {}).get("folder", ".")) / name)
