"""What a build leaves: the mirror, its deviation and its metrics, as records."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, NamedTuple

if TYPE_CHECKING:
    from mirror_cad.deviation import Deviation, ExplainedDeviation, RayDeviation
    from mirror_cad.mirror import Mirror
    from mirror_cad.stage_deviation import StageDeviation
    from mirror_cad.surfaces.faithful import Faithful
    from mirror_studio.build.wanted import TargetFigures
    from mirror_studio.json_types import JsonObject
    from mirror_studio.report.requirement import Requirement
    from mirror_studio.rules.of_spec import SpecRules
    from raytrace.measures.ghost import Ghost
    from raytrace.placement import Placement


@dataclass(frozen=True, slots=True)
class FieldOfView:
    """One field of view, degrees, None where it cannot be measured.

    Attributes
    ----------
    section
        Of the section alone, with the eye on the axis through its centre.
    traced
        With the eye where it sits.
    """

    section: float | None = None
    traced: float | None = None


@dataclass(frozen=True, slots=True)
class LaneFigures:
    """Lane straightness, percent, None where it cannot be measured.

    Attributes
    ----------
    traced
        By exact rays.
    image
        From the driver's picture.
    """

    traced: float | None = None
    image: float | None = None


@dataclass(frozen=True, slots=True)
class OnPlane:
    """How far rays by way of the STL land from those of the surface, on the reference plane.

    Attributes
    ----------
    max_mm, rms_mm
        None without a ray that both reflect.
    rays
        How many were compared.
    """

    max_mm: float | None = None
    rms_mm: float | None = None
    rays: int = 0


@dataclass(frozen=True, slots=True)
class PlateFigures:
    """Area of the optical face (mm²), volume (mm³), and the other face against the true offset (mm)."""

    area_mm2: float
    volume_mm3: float
    back_error_mm: float


class StepCheck(NamedTuple):
    """A STEP file read back: farthest point by the kernel and from its text (mm), relative change of the volume."""

    step_max_mm: float
    part21_max_mm: float
    volume_relative: float


@dataclass(frozen=True, slots=True)
class FileChecks:
    """How far the files of a set read back from what was designed.

    Attributes
    ----------
    step
        The STEP file.
    sheet_max_mm
        Farthest point of the untrimmed sheet, mm.
    outline_box_mm
        The outline's box, mm.
    points
        Rows of the table of points.
    """

    step: StepCheck
    sheet_max_mm: float
    outline_box_mm: float
    points: int


@dataclass(frozen=True, slots=True)
class GlassFigures:
    """What the glass before a reflecting back does to the view.

    Attributes
    ----------
    reflecting
        "back".
    index
        Of refraction.
    ghost
        The front's own reflection beside the image.
    h_fov_added_deg
        Horizontal field of view against that without glass, degrees.
    """

    reflecting: Literal["front", "back"]
    index: float
    ghost: Ghost
    h_fov_added_deg: float | None


@dataclass(frozen=True, slots=True)
class MethodFigures:
    """A mirror made by one method.

    Attributes
    ----------
    deviation
        From the design, as `total` in deviation.json.
    h_fov_deg, v_fov_left_deg
        Traced fields of view, degrees.
    lane_straightness_percent
        Traced.
    """

    deviation: StageDeviation
    h_fov_deg: float
    v_fov_left_deg: float
    lane_straightness_percent: float | None


@dataclass(frozen=True, slots=True)
class MethodChange:
    """The faithful surface against the decoupled one.

    Attributes
    ----------
    sag_max_mm, sag_max_at_mm, sag_rms_mm
        Height moved, with point and normal at the origin held, mm.
    sag_best_fit_max_mm
        Height moved after the best fit of a rigid motion, mm.
    slope_max_arcmin
        The normal's turn, arc minutes.
    ray_max_arcmin, ray_rms_arcmin
        The reflected ray's turn, arc minutes.
    on_plane_max_mm, on_plane_rms_mm
        Between where rays land on the lane's plane, mm.
    """

    sag_max_mm: float
    sag_max_at_mm: tuple[float, float]
    sag_rms_mm: float
    sag_best_fit_max_mm: float
    slope_max_arcmin: float
    ray_max_arcmin: float | None
    ray_rms_arcmin: float | None
    on_plane_max_mm: float | None
    on_plane_rms_mm: float | None


@dataclass(frozen=True, slots=True, eq=False)
class MethodComparison:
    """The decoupled and the faithful surface of one specification.

    Attributes
    ----------
    decoupled, faithful
        Each by itself.
    change
        From the first to the second.
    floor
        How the faithful surface's deviation fell with its spans.
    """

    decoupled: MethodFigures
    faithful: MethodFigures
    change: MethodChange
    floor: Faithful | None

    def both(self) -> tuple[MethodFigures, MethodFigures]:
        """Decoupled and faithful."""
        return self.decoupled, self.faithful


@dataclass(frozen=True, slots=True, eq=False)
class Metrics:
    """What metrics.json holds of a mirror; without arguments, a mirror of which nothing was measured.

    Attributes
    ----------
    h_fov_deg, v_fov_left_deg
        Fields of view across, and upright at the left edge.
    lane_straightness_percent
        Of the lane on the reference plane.
    stl_on_plane, stl_interpolated_on_plane
        What the STL does to rays, by its facets and by interpolated normals.
    measures
        The registered measures by their names, each in its own unit.
    explained, ray_deviation
        The budget of errors, from the deviation.
    methods
        The decoupled and the faithful surface side by side.
    rays
        How many rays of the driver's picture had which status.
    eye_mm
        (x, y, z) of the eye.
    plate, files
        The solid, and the files read back.
    glass
        Only where the back reflects.
    limits
        What [limits] asks of the view.
    target
        What the mirror misses of the view that it was made for; None for a mirror from laws.
    rules
        Radii and sizes beside the rule of the road that the specification names; None where it names none.
    """

    h_fov_deg: FieldOfView = FieldOfView()
    v_fov_left_deg: FieldOfView = FieldOfView()
    lane_straightness_percent: LaneFigures = LaneFigures()
    stl_on_plane: OnPlane = OnPlane()
    stl_interpolated_on_plane: OnPlane = OnPlane()
    measures: Mapping[str, float | None] = field(default_factory=dict)
    explained: ExplainedDeviation | None = None
    ray_deviation: RayDeviation | None = None
    methods: MethodComparison | None = None
    rays: Mapping[str, int] = field(default_factory=dict)
    eye_mm: tuple[float, float, float] | None = None
    plate: PlateFigures | None = None
    files: FileChecks | None = None
    glass: GlassFigures | None = None
    limits: tuple[Requirement, ...] = ()
    target: TargetFigures | None = None
    rules: SpecRules | None = None


@dataclass(frozen=True, slots=True, eq=False)
class TraceMetrics:
    """What metrics.json holds of a traced file.

    Attributes
    ----------
    h_fov_deg
        Between the outline's edges, degrees; None where it cannot be measured.
    lane_straightness_percent
        Of the lane on the reference plane.
    rays
        How many rays of the driver's picture had which status.
    normals_from
        What the normals were taken from.
    eye_mm
        (x, y, z) of the eye.
    box_mm
        (x_min, x_max, y_min, y_max) of what reflects.
    placement
        Where the mirror is in its file.
    """

    h_fov_deg: float | None
    lane_straightness_percent: LaneFigures
    rays: Mapping[str, int]
    normals_from: str
    eye_mm: tuple[float, float, float]
    box_mm: tuple[float, float, float, float]
    placement: Placement


@dataclass(frozen=True, slots=True, eq=False)
class Manifest:
    """What a set of files was made from.

    Attributes
    ----------
    spec
        The specification as JSON; None where it is not known.
    versions
        Of the packages.
    notes
        What a user should know of the mirror.
    files
        SHA-256 of each file by its name.
    """

    spec: JsonObject | None = None
    versions: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    files: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Built:
    """What a build leaves in memory.

    Attributes
    ----------
    mirror, deviation, metrics
        The mirror, its deviation and what was measured.
    missed
        A sentence for each tolerance or limit that is not met.
    """

    mirror: Mirror
    deviation: Deviation
    metrics: Metrics
    missed: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Compared:
    """One of our figures beside the paper's."""

    ours: float | None
    paper: float


@dataclass(frozen=True, slots=True)
class PaperRow:
    """One mirror of the paper's table 1: fields of view in degrees, lane straightness in percent."""

    h_fov_deg: Compared
    v_fov_left_deg: Compared
    lane_straightness_percent: Compared
