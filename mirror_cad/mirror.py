"""A specification in, a Mirror out: its surface, outline, files and deviation. The only module that knows the order."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mirror_cad.designed import DesignedCurvature
from mirror_cad.deviation import CurvatureDeviation, compare_stages
from mirror_cad.errors import OutlineError, SpecError, WriteError
from mirror_cad.laws import CurvatureLaw, Law, Span
from mirror_cad.laws.curvature import smooth_extrapolation
from mirror_cad.laws.matched import with_solved
from mirror_cad.laws.matching import solve_match
from mirror_cad.mesh import SurfaceMesh
from mirror_cad.outline import Outline, truck_outline
from mirror_cad.profile import check_profile, existing_interval, integrate_exactly, integrate_ode, sine_of_tangent_angle
from mirror_cad.reflection import reflected_mesh, reflected_surface
from mirror_cad.section_fov import circle_section_fov, section_fov
from mirror_cad.sections import DecoupledSag, Sag, check_circles, check_steps, existing_half_height
from mirror_cad.spec import MirrorSpec
from mirror_cad.surfaces import fit as fitting
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.faithful import REST_GAINED, Faithful, closest_surface
from mirror_cad.surfaces.fit import Fit, FitTask
from mirror_cad.surfaces.offset import offset_surface
from mirror_cad.surfaces.sphere import (
    SPHERE_CURVATURE_PERCENT,
    SPHERE_DEGREE,
    SPHERE_POSITION_MM,
    SphericalSag,
    spherical_domain,
)

if TYPE_CHECKING:
    import build123d
    import cadquery

    from mirror_cad.occt.solid import Plate

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

STL_ROUNDING = float(np.finfo(np.float32).eps)  # relative: rounding to float32 moves a corner by less


@dataclass(frozen=True, eq=False)
class Mirror:
    """A designed mirror. Frame: mm, x right, y up, z towards the driver; origin at the centre of the surface.

    surface : u = x, v = y.   outline : closed curve in (x, y).   box : the outline's (x_min, x_max, y_min, y_max).
    curvature : the design.   exact : the sag of the decoupled surface by exact quadrature.   model : the exact sag of the
    method that the spec names; that same one, the faithful one or the sphere.   integrated : the model with its profile as
    integrated.
    faithful : how the faithful surface was found, or None.   fit : how the surface was fitted and what it reached.
    matched : the key and value that `match` was solved for.
    notes : what a user should know and no error says.   reflected : whether surface, outline and box are those of the part
    that is made, which of a right-hand mirror is the reflection of the design (`as_made`).
    """

    spec: MirrorSpec
    surface: BSplineSurface
    outline: Outline
    box: Box
    curvature: DesignedCurvature
    exact: DecoupledSag
    model: Sag
    integrated: Sag
    faithful: Faithful | None
    fit: Fit
    matched: tuple[str, float] | None
    notes: tuple[str, ...]
    reflected: bool = False

    def __repr__(self) -> str:
        return f"<Mirror {self.spec.name!r}: {'; '.join(f'{name} {value}' for name, value in self._main_figures())}>"

    def _repr_html_(self) -> str:
        rows = "".join(f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in self._main_figures())
        return f"<table style='text-align: left'><caption>{escape(self.spec.name)}</caption>{rows}</table>"

    def _main_figures(self) -> list[tuple[str, str]]:
        x_min, x_max, y_min, y_max = self.box
        h_fov, v_fov = np.degrees(self.section_fields_of_view())
        solved = self.matched[1] if self.matched else None
        return [("Rx", self.spec.horizontal.in_words(solved)), ("Ry", self.spec.vertical.in_words()),
                ("size", f"{x_max - x_min:.4g} × {y_max - y_min:.4g} mm"),
                ("section H-FOV", f"{h_fov:.2f}°"), ("section V-FOV at the left edge", f"{v_fov:.2f}°"),
                ("surface", f"{self.spec.surface.method}, degree {self.surface.degree_u} × {self.surface.degree_v}"
                            + ("" if self.fit.met else ", a tolerance is missed"))]

    @cached_property
    def as_made(self) -> Mirror:
        """The mirror as its files have it: itself, or for `[part] hand = "right"` its reflection in x = 0.

        Surface, outline and box of that one, and what follows from them, are reflected; the laws are the left-hand mirror's.
        """
        if self.reflected or self.spec.part.hand == "left":
            return self
        outline = self.outline.mirrored()
        return replace(self, surface=reflected_surface(self.surface), outline=outline, box=outline.bounding_box(),
                       reflected=True)

    @cached_property
    def plate(self) -> Plate:
        """The solid with its optical face, area and volume. Raises: SolidError."""
        from mirror_cad.occt.solid import plate

        glass = self.spec.glass
        return plate(self.surface, self.outline, glass.thickness_mm, glass.reflecting, self._other_face)

    @cached_property
    def front(self) -> BSplineSurface:
        """The surface towards the driver: the optical one, or the one before it that light goes in by. Raises: SolidError."""
        return self.surface if self.spec.glass.reflecting == "front" else self._other_face[0]

    @cached_property
    def _other_face(self) -> tuple[BSplineSurface, float]:
        return offset_surface(self.surface, self.outline, self.spec.glass.thickness_mm, self.spec.glass.reflecting)

    @property
    def reference(self) -> Sag:
        """What height and slope of the model and the total are told against, which the laws alone do not say: the decoupled
        surface, and the sphere itself where that is asked for."""
        return self.model if self.spec.surface.method == "sphere" else self.exact

    @property
    def left_height_mm(self) -> float:
        """The height at the left edge before the corners are rounded; of an outline file its bounding box's."""
        given = self.spec.outline
        return given.left_height_mm if given.file is None else self.box[3] - self.box[2]

    def section_fields_of_view(self) -> tuple[float, float]:
        """Section H-FOV, and section V-FOV at the left edge, radians, as table 1 of Lee et al. (2014) defines them."""
        distance = self.spec.eye.distance_mm
        kappa = float(self.curvature.vertical(self.box[0]))
        return (section_fov(self.exact.profile, self.box[0], self.box[1], distance),
                circle_section_fov(kappa, 0.5 * self.left_height_mm, distance))

    def export_step(self, path: str | Path) -> None:
        """Write the plate as AP242 STEP, the optical face named and coloured; of glass that reflects from its back the
        front face is named too. Raises: WriteError, SolidError."""
        from mirror_cad.occt.step import FRONT_FACE, GLASS_COLOUR, OPTICAL_FACE, Part, write_step

        plate, name = self.as_made.plate, self.spec.name
        faces = {OPTICAL_FACE: plate.optical}
        if self.spec.glass.reflecting == "back":
            faces[FRONT_FACE] = plate.front_face
        write_step(Path(path), [Part(plate.solid, name, GLASS_COLOUR, faces)], name, self.spec.part.hand)

    def export_surface_step(self, path: str | Path) -> None:
        """Write the untrimmed sheet, `surface_margin_mm` beyond the outline, with the trim curve as a wire."""
        from mirror_cad.occt.solid import outer_wire, sheet
        from mirror_cad.occt.step import OPTICAL_COLOUR, OPTICAL_FACE, TRIM_CURVE, Part, write_step

        made, name = self.as_made, f"{self.spec.name}-surface"
        shell, face = sheet(made.surface, made.sheet_box())
        parts = [Part(shell, name, OPTICAL_COLOUR, {OPTICAL_FACE: face}),
                 Part(outer_wire(made.plate.optical), TRIM_CURVE)]
        write_step(Path(path), parts, name, self.spec.part.hand)

    def export_stl(self, path: str | Path, deflection_mm: float | None = None) -> None:
        """Write the plate as binary STL, no facet farther than the absolute deflection from its face; default: the spec's.

        Raises: WriteError for a deflection that is not positive and finite or that no STL of this plate can hold, and
        where the file cannot be written.
        """
        from mirror_cad.occt.plate_mesh import plate_mesh
        from mirror_cad.occt.tessellate import write_mesh

        made = self.as_made
        wanted = self.spec.export.stl_deflection_mm if deflection_mm is None else deflection_mm
        if not 0.0 < wanted < np.inf:
            raise WriteError(f"{path}: a deflection of {wanted:g} mm cannot be held: it must be finite and above 0")
        rounding = STL_ROUNDING * float(np.abs(made.plate.offset.poles).max())
        if wanted < 2.0 * rounding:
            raise WriteError(f"{path}: a deflection of {wanted:g} mm cannot be held: STL rounds the corners of this plate to "
                             f"{rounding:.1g} mm; ask for {2.0 * rounding:.1g} mm or more")
        try:
            mesh = plate_mesh(made.plate.front, made.plate.back, made.outline, wanted - rounding)
        except WriteError as error:
            raise WriteError(f"{path}: {error}") from None
        write_mesh(Path(path), mesh, self.spec.part.hand)

    def sheet_box(self) -> Box:
        """The outline's box with the margin of [export] on every side, as far as the surface exists."""
        margin = self.spec.export.surface_margin_mm
        domain = self.surface.domain
        return (max(self.box[0] - margin, domain[0]), min(self.box[1] + margin, domain[1]),
                max(self.box[2] - margin, domain[2]), min(self.box[3] + margin, domain[3]))

    def grid_points(self, pitch_mm: float = 5.0) -> Array:
        """x, y, z, nx, ny, nz on a regular grid inside the outline, (n, 6); the grid holds the origin."""
        from mirror_cad.surfaces.differential import normals

        x_min, x_max, y_min, y_max = self.box
        x, y = np.meshgrid(pitch_mm * np.arange(np.ceil(x_min / pitch_mm), x_max / pitch_mm + 1e-9),
                           pitch_mm * np.arange(np.ceil(y_min / pitch_mm), y_max / pitch_mm + 1e-9))
        inside = self.outline.contains(x, y)
        d = self.surface.derivatives(x[inside], y[inside])
        return np.hstack([d["s"], normals(d["u"], d["v"])])

    def deviation(self, read_back: BSplineSurface | None = None, stl: SurfaceMesh | None = None) -> CurvatureDeviation:
        """Realised against designed curvature, stage by stage, on the optical face as read back from STEP (and STL).

        read_back, stl : in the frame of the design, so of a right-hand mirror reflected again. Without files given, they are
        written to a temporary folder and read back here.
        """
        if read_back is None or stl is None:
            from mirror_cad.occt.step import read_step
            from mirror_cad.occt.tessellate import read_stl

            with tempfile.TemporaryDirectory(prefix="mirror-cad-") as folder:
                self.export_step(Path(folder) / "mirror.step")
                self.export_stl(Path(folder) / "mirror.stl")
                read_back = read_step(Path(folder) / "mirror.step").optical_surface()
                stl = read_stl(Path(folder) / "mirror.stl")
            if self.as_made.reflected:
                read_back, stl = reflected_surface(read_back), reflected_mesh(stl)
        if self.spec.glass.reflecting == "back":
            # Seen from the glass, where light meets the optical face.
            stl = SurfaceMesh(stl.vertices, stl.faces[:, ::-1].copy())
        return compare_stages(self.curvature, self.outline, self.reference, self.model, self.integrated, self.surface,
                              read_back, stl, self.spec.surface.position_tolerance_mm,
                              self.spec.surface.curvature_tolerance_percent,
                              self.spec.limits.curvature_percent)

    def to_build123d(self) -> build123d.Part:
        """The plate as a build123d Part (mm)."""
        plate = self.as_made.plate  # its kernel is checked before build123d loads it
        import build123d

        return build123d.Part([build123d.Solid(plate.solid)], label=self.spec.name)

    def to_cadquery(self) -> cadquery.Workplane:
        """The same plate as a cadquery Workplane (mm)."""
        from mirror_cad.occt.kernel import check_kernel_for_cadquery

        check_kernel_for_cadquery()
        import cadquery

        return cadquery.Workplane(obj=cadquery.Solid(self.as_made.plate.solid))


def design(spec: MirrorSpec) -> Mirror:
    """Curvature laws → profile → sag → B-spline surface, with the outline it will be cut to.

    Raises: SpecError, ProfileError, OutlineError or SurfaceError for a mirror that cannot be.
    """
    outline, read_notes = _outline(spec)
    box = outline.bounding_box()
    x_min, x_max, y_min, y_max = box
    level_mm = _level(spec, box)
    span = Span(*(spec.horizontal.span_mm or (x_min, x_max)))
    matched = _solved(spec.horizontal, spec.eye.distance_mm, span, x_min, x_max, level_mm)
    horizontal = _law(with_solved(spec.horizontal, matched), span)
    vertical = _law(spec.vertical, span)
    half_height = max(abs(y_min), abs(y_max))
    check_profile(sine_of_tangent_angle(_series(horizontal, min(x_min, level_mm), max(x_max, level_mm)), level_mm),
                  level_mm, x_min, x_max)
    vertical = _eased(vertical, x_min, x_max, 1.0 / half_height)
    wanted, notes = _wanted_domain(spec, box), [*read_notes, *_remarks(spec, box)]
    check_circles(_series(vertical, wanted[0], wanted[1]), x_min, x_max, half_height)

    kappa = _series(horizontal, wanted[0], wanted[1])
    x_low, x_high = existing_interval(sine_of_tangent_angle(kappa, level_mm), level_mm, wanted[0], wanted[1])
    x_low, x_high = min(x_low, x_min), max(x_high, x_max)
    kappa, kappa_2 = _series(horizontal, x_low, x_high), _series(vertical, x_low, x_high)
    half = max(half_height, existing_half_height(kappa_2, x_low, x_high, max(-wanted[2], wanted[3])))
    domain = (x_low, x_high, max(wanted[2], -half), min(wanted[3], half))
    surface_spec = spec.surface
    sphere: SphericalSag | None = None
    if surface_spec.method == "sphere":
        sphere = SphericalSag(float(kappa(0.0)), level_mm)
        domain = spherical_domain(sphere, box, domain)
    if domain != wanted:
        notes.append(f"the surface reaches x {domain[0]:.1f} to {domain[1]:.1f}, y {domain[2]:.1f} to {domain[3]:.1f} mm, "
                     f"less than blank and margin ask for: beyond, it would be steeper than 80°")
    exact_profile = integrate_exactly(sine_of_tangent_angle(kappa, level_mm), kappa)
    profile = exact_profile
    if surface_spec.integration != "quadrature":
        profile = integrate_ode(kappa, exact_profile, surface_spec.integration, surface_spec.step_mm or 1.0)
    exact = DecoupledSag(exact_profile, kappa_2)
    designed = DesignedCurvature(kappa, kappa_2)
    breaks = horizontal.all_breaks(kappa), vertical.all_breaks(kappa_2)
    if surface_spec.method == "decoupled":
        check_steps(kappa_2, [b.x_mm for b in breaks[1] if b.smoothness < 0], x_min, x_max, half_height)
    degree, spans = surface_spec.degree, surface_spec.spans
    faithful: Faithful | None = None
    model: Sag = exact
    integrated: Sag = exact if profile is exact_profile else DecoupledSag(profile, kappa_2)
    width, gained, ends = domain[1] - domain[0], fitting.DECOUPLED_GAINED, None
    if surface_spec.method == "faithful":
        rest = fitting.orders_at_breaks(*breaks, REST_GAINED, width)
        faithful = closest_surface(designed, outline, exact, domain, rest, degree, spans)
        model = integrated = faithful.sag
        gained, ends, degree = fitting.FAITHFUL_GAINED, faithful.ends, faithful.degree
    position_mm, percent = surface_spec.position_tolerance_mm, surface_spec.curvature_tolerance_percent
    if sphere is not None:
        model = integrated = sphere
        if surface_spec.fit == "collocation" and spans == "auto":
            position_mm, percent = min(position_mm, SPHERE_POSITION_MM), min(percent, SPHERE_CURVATURE_PERCENT)
            degree = SPHERE_DEGREE if degree == "auto" else degree
    rms = designed.rms(outline)
    task = FitTask(integrated, domain, box, fitting.orders_at_breaks(*breaks, gained, width),
                   lambda x: designed.percent_of(x, rms), position_mm, percent, ends)
    if surface_spec.fit == "collocation":
        fit = fitting.fit_by_collocation(task, degree, spans)
    else:
        from mirror_cad.occt.fit import fit_by_kernel

        fit = fit_by_kernel(task, surface_spec.fit)
    return Mirror(spec, fit.surface, outline, box, designed, exact, model, integrated, faithful, fit, matched, tuple(notes))


# Most changes to a design leave its outline and one of its laws alone: what they give is kept. All of it is frozen.
_truck_outline = lru_cache(maxsize=8)(truck_outline)
_solved = lru_cache(maxsize=8)(solve_match)
_eased = lru_cache(maxsize=8)(smooth_extrapolation)
_series = lru_cache(maxsize=32)(CurvatureLaw.series)


@lru_cache(maxsize=16)
def _law(law: Law, span: Span) -> CurvatureLaw:
    return law.over(span)


def _outline(spec: MirrorSpec) -> tuple[Outline, list[str]]:
    """The outline, and what a user should know of the file that it was read from."""
    given, blank = spec.outline, spec.blank
    if given.file is None:
        return _truck_outline(given.width_mm, given.left_height_mm, given.right_height_mm, given.corner_radius_mm), []
    from mirror_cad.outline.files import open_outline

    read = open_outline(Path(given.file), given.file_options)
    outline = read.outline
    x_min, x_max, y_min, y_max = outline.bounding_box()
    half_width, half_height = blank.width_mm / 2, blank.height_mm / 2
    reach, faults = f"x {x_min:.1f} to {x_max:.1f}, y {y_min:.1f} to {y_max:.1f} mm", []
    if x_min < -half_width or x_max > half_width or y_min < -half_height or y_max > half_height:
        faults.append(f"{given.file}: the outline reaches {reach}, beyond the blank of {blank.width_mm:g} × "
                      f"{blank.height_mm:g} mm about the origin: move it, check its unit, or enlarge [blank]")
    elif not (x_min < 0 < x_max and y_min < 0 < y_max):
        faults.append(f"{given.file}: the outline, {reach}, does not hold the origin, which is the centre of the mirror: an "
                      "outline file is in mirror coordinates")
    if faults:  # with what else is to be known of the file, which may be the cause
        raise OutlineError("\n".join([*faults, *read.notes]))
    return outline, list(read.notes)


def _level(spec: MirrorSpec, box: Box) -> float:
    level = spec.horizontal.level_at
    if level == "centre":
        return 0.5 * (box[0] + box[1])
    if level in ("left", "right"):
        return box[0] if level == "left" else box[1]
    half_blank = spec.blank.width_mm / 2
    if not -half_blank <= float(level) <= half_blank:
        raise SpecError(f"horizontal.level_at = {float(level):g} lies outside the blank, −{half_blank:g} to {half_blank:g} mm")
    return float(level)


def _remarks(spec: MirrorSpec, box: Box) -> list[str]:
    """What the two laws have to say of themselves on this mirror."""
    return [f"the {name} law {remark}" for name, law in (("horizontal", spec.horizontal), ("vertical", spec.vertical))
            for remark in law.remarks(box[0], box[1])]


def _wanted_domain(spec: MirrorSpec, box: Box) -> Box:
    """Blank and outline with its margin, whichever reaches farther."""
    margin, blank = spec.export.surface_margin_mm, spec.blank
    return (min(-blank.width_mm / 2, box[0] - margin), max(blank.width_mm / 2, box[1] + margin),
            min(-blank.height_mm / 2, box[2] - margin), max(blank.height_mm / 2, box[3] + margin))
