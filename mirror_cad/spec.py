"""What a mirror is asked to be: each section of a specification and its keys, with unit, range and default."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, field_validator, model_validator
from pydantic.functional_validators import PlainValidator

from mirror_cad.outline.options import AS_DRAWN, FILE_JOIN_TOLERANCE_MM, LARGEST_JOIN_MM, FileOptions
from mirror_cad.spec_laws import AnyHorizontal, AnyLaw
from mirror_cad.spec_section import Coordinate, Length, Number, Section

# Characters of a part's number or revision, and of its title: what a line of the report's head holds.
LONGEST_MARK, LONGEST_TITLE = 48, 100
LARGEST_LIMIT = 1e6  # degrees or percent: beyond anything that an angle or a lane can have


class Blank(Section):
    width_mm: Length = 250.0
    height_mm: Length = 380.0


class OutlineSpec(Section):
    """A quadrilateral with tangent corner arcs, or a closed curve from a DXF or SVG file.

    layer, join_mm, loop : how the file is read, as `mirror_cad.outline.options.FileOptions` has it.
    """

    width_mm: Length = 230.0
    left_height_mm: Length = 270.0
    right_height_mm: Length = 340.0
    corner_radius_mm: Annotated[Number, Field(ge=0, le=1e5)] = 40.0
    file: str | None = None
    layer: Annotated[str, Field(min_length=1, max_length=255)] | None = None
    join_mm: Annotated[Number, Field(ge=FILE_JOIN_TOLERANCE_MM, le=LARGEST_JOIN_MM)] | None = None
    loop: Literal["only", "outermost"] | None = None

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

    thickness_mm: Annotated[Number, Field(gt=0, le=1000)] = 3.0
    reflecting: Literal["front", "back"] = "front"
    index: Annotated[Number, Field(ge=1, le=3)] = 1.52


class SurfaceSpec(Section):
    method: Literal["decoupled", "faithful"] = "decoupled"
    integration: Literal["quadrature", "euler", "rk4"] = "quadrature"
    step_mm: Annotated[Number, Field(ge=1e-3, le=1000)] | None = None
    fit: Literal["collocation", "occt-interpolate", "occt-approximate"] = "collocation"
    degree: Annotated[int | Literal["auto"], PlainValidator(lambda value: _degree(value))] = "auto"
    spans: Annotated[tuple[int, int] | Literal["auto"], PlainValidator(lambda value: _spans(value))] = "auto"
    position_tolerance_mm: Annotated[Number, Field(ge=1e-9, le=1)] = 1e-5
    curvature_tolerance_percent: Annotated[Number, Field(ge=1e-6, le=100)] = 0.01

    @model_validator(mode="after")
    def _belonging(self) -> SurfaceSpec:
        if self.integration == "quadrature" and self.step_mm is not None:
            raise ValueError("step_mm belongs to integration = \"euler\" or \"rk4\"; quadrature chooses its own nodes")
        if self.integration != "quadrature" and self.step_mm is None:
            raise ValueError(f"integration = \"{self.integration}\" needs step_mm, the paper's h")
        if self.method == "faithful" and self.integration != "quadrature":
            raise ValueError(f"integration = \"{self.integration}\" belongs to method = \"decoupled\": the faithful surface "
                             "starts from the exact profile")
        if self.fit != "collocation" and (self.degree != "auto" or self.spans != "auto"):
            raise ValueError("degree and spans belong to fit = \"collocation\": the kernel's own routes choose theirs")
        return self


def _degree(value: Any) -> int | str:
    if value == "auto" or (isinstance(value, int) and not isinstance(value, bool) and 3 <= value <= 9):
        return value
    raise ValueError("must be \"auto\" or a whole number from 3 to 9")


def _spans(value: Any) -> tuple[int, int] | str:
    if value == "auto":
        return "auto"
    if isinstance(value, list | tuple) and len(value) == 2:
        nx, ny = value
        if all(isinstance(n, int) and not isinstance(n, bool) and 1 <= n <= 400 for n in (nx, ny)):
            return (nx, ny)
    raise ValueError("must be \"auto\" or two whole numbers from 1 to 400, [nx, ny]")


class PartSpec(Section):
    """What a drawing calls the mirror: said in the report and without effect on the surface.

    number, revision : “none stated” without one.   hand : the side of the vehicle; the frame stays as it is, x to the right
    as the driver looks at the mirror, and the files hold what the laws say in it.
    """

    number: str | None = None
    revision: str | None = None
    hand: Literal["left", "right"] = "left"
    title: str | None = None

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
    """

    curvature_percent: Annotated[Number, Field(gt=0, le=1000)] | None = None
    h_fov_deg: Ends = None
    v_fov_left_deg: Ends = None
    lane_straightness_percent: Ends = None


def _ends(value: Any) -> tuple[float, float] | None:
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
    distance_mm: Length = 762.0
    aligned: Literal["right", "centre", "left"] = "right"


class Lane(Section):
    """Y = y0 + slope·(X − x0) in the reference plane."""

    x0_mm: Coordinate = 0.0
    y0_mm: Coordinate = 2400.0
    slope: Annotated[Number, Field(ge=-1e3, le=1e3)] = 0.6


class SceneSpec(Section):
    image: str = "road"
    distance_mm: Annotated[Number, Field(gt=0, le=1e6)] = 8200.0
    width_mm: Annotated[Number, Field(gt=0, le=1e6)] = 9000.0
    centre_mm: tuple[Coordinate, Coordinate] = (-2300.0, 0.0)
    lane: Lane = Lane()

    @field_validator("centre_mm", mode="before")
    @classmethod
    def _pair(cls, value: Any) -> Any:
        return tuple(value) if isinstance(value, list) else value


class View(Section):
    width_px: Annotated[int, Field(ge=16, le=4096)] = 1280


class Export(Section):
    stl_deflection_mm: Annotated[Number, Field(ge=1e-3, le=10)] = 0.01
    surface_margin_mm: Annotated[Number, Field(ge=0, le=1000)] = 15.0


class MirrorSpec(Section):
    """One mirror, frozen. Lengths in mm, angles in degrees, x right, y up, z towards the driver."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$")]
    horizontal: AnyHorizontal
    vertical: AnyLaw
    blank: Blank = Blank()
    outline: OutlineSpec = OutlineSpec()
    glass: Glass = Glass()
    surface: SurfaceSpec = SurfaceSpec()
    part: PartSpec = PartSpec()
    limits: Limits = Limits()
    eye: Eye = Eye()
    scene: SceneSpec = SceneSpec()
    view: View = View()
    export: Export = Export()

    @field_validator("outline", "scene", mode="after")
    @classmethod
    def _beside_the_spec(cls, section: Any, info: ValidationInfo) -> Any:
        """File names are relative to the specification's folder; here they become paths."""
        folder = Path((info.context or {}).get("folder", "."))
        if isinstance(section, OutlineSpec) and section.file is not None:
            return section.model_copy(update={"file": str(folder / section.file)})
        if isinstance(section, SceneSpec) and section.image != "road":
            return section.model_copy(update={"image": str(folder / section.image)})
        return section

    @model_validator(mode="after")
    def _fits(self) -> MirrorSpec:
        faults = []
        outline, blank = self.outline, self.blank
        if outline.file is None:
            if outline.width_mm > blank.width_mm:
                faults.append(f"outline.width_mm = {outline.width_mm:g} is wider than the blank "
                              f"(blank.width_mm = {blank.width_mm:g})")
            for key in ("left_height_mm", "right_height_mm"):
                if getattr(outline, key) > blank.height_mm:
                    faults.append(f"outline.{key} = {getattr(outline, key):g} is higher than the blank "
                                  f"(blank.height_mm = {blank.height_mm:g})")
        if faults:
            raise ValueError("; ".join(faults))
        return self
