"""A designed mirror: its record, what is asked of it, and the files that are made of it."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mirror_cad.designed import DesignedCurvature
from mirror_cad.deviation import Deviation, compare_stages
from mirror_cad.errors import WriteError
from mirror_cad.kernel import PlateText, write_and_read_apart, write_apart
from mirror_cad.mesh import SurfaceMesh
from mirror_cad.outline import Outline
from mirror_cad.outline.transition import TransitionLine, transition_line
from mirror_cad.plate_files import PlateFiles, ReadStep
from mirror_cad.reflection import reflected_mesh, reflected_surface
from mirror_cad.section_fov import circle_section_fov, section_fov
from mirror_cad.sections import DecoupledSag, Sag
from mirror_cad.spec import MirrorSpec
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.faithful import Faithful
from mirror_cad.surfaces.fit import Fit
from mirror_cad.surfaces.from_view import FromView
from mirror_cad.surfaces.offset import offset_surface

if TYPE_CHECKING:
    import build123d
    import cadquery

    from mirror_cad.occt.convert import BSplineArrays
    from mirror_cad.occt.solid import Plate

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

STL_ROUNDING = float(np.finfo(np.float32).eps)  # relative: rounding to float32 moves a corner by less


@dataclass(frozen=True, eq=False)
class Mirror:
    """A designed mirror. Frame: mm, x right, y up, z towards the driver; origin at the centre of the surface.

    Attributes
    ----------
    spec : MirrorSpec
        What was asked for.
    surface : BSplineSurface
        The optical face, untrimmed; u = x, v = y.
    outline : Outline
        Closed curve in (x, y).
    box : tuple
        The outline's (x_min, x_max, y_min, y_max).
    curvature : DesignedCurvature
        The design.
    exact : DecoupledSag
        The decoupled surface by exact quadrature.
    model : Sag
        The exact surface of the method that the spec names: `exact`, the faithful one or the sphere.
    integrated : Sag
        The model with its profile as integrated.
    faithful : Faithful or None
        How the faithful surface was found.
    fit : Fit
        How the surface was fitted and what it reached.
    matched : tuple or None
        The key and value that `match` was solved for.
    notes : tuple of str
        What a user should know and no error says.
    from_view : FromView or None
        How the surface of a wanted view was found. Such a mirror has no laws: `curvature` is what it has along y = 0, and
        `exact` the decoupled surface of that.
    reflected : bool
        Whether surface, outline and box are those of the part that is made, which of a right-hand mirror is the reflection of
        the design (`as_made`).
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
    from_view: FromView | None = None
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
        made_for = ([("view", self.spec.target.in_words())] if self.spec.target is not None else
                    [("Rx", self.spec.horizontal.in_words(solved)), ("Ry", self.spec.vertical.in_words())])
        return [*made_for,
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
    def transition(self) -> TransitionLine | None:
        """The line that parts the aspheric part from the main part, across this outline; None without one."""
        x = self.spec.part.transition_mm
        return None if x is None else transition_line(self.outline, -x if self.reflected else x)

    @cached_property
    def plate(self) -> Plate:
        """The solid with its optical face, area and volume.

        Raises
        ------
        SolidError
        """
        from mirror_cad.occt.solid import plate

        glass = self.spec.glass
        return plate(self.surface, self.outline, glass.thickness_mm, glass.reflecting, self._other_face)

    @cached_property
    def front(self) -> BSplineSurface:
        """The surface towards the driver: the optical one, or the one before it that light goes in by.

        Raises
        ------
        SolidError
        """
        return self.surface if self.spec.glass.reflecting == "front" else self._other_face[0]

    @property
    def back(self) -> BSplineSurface:
        """The surface away from the driver.

        Raises
        ------
        SolidError
        """
        return self._other_face[0] if self.spec.glass.reflecting == "front" else self.surface

    @property
    def back_error_mm(self) -> float:
        """How far the face that is not the optical one is from the true offset, mm.

        Raises
        ------
        SolidError
        """
        return self._other_face[1]

    @cached_property
    def _other_face(self) -> tuple[BSplineSurface, float]:
        return offset_surface(self.surface, self.outline, self.spec.glass.thickness_mm, self.spec.glass.reflecting)

    @property
    def reference(self) -> Sag:
        """What height and slope of the model and the total are told against, which the laws alone do not say.

        The decoupled surface, and the sphere itself where that is asked for.
        """
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
        """Write the plate as AP242 STEP, the optical face named and coloured.

        Of glass that reflects from its back the front face is named too.

        Parameters
        ----------
        path : str or Path
            Of the file.

        Raises
        ------
        WriteError, SolidError
            Where the file cannot be written, or the plate cannot be.
        """
        from mirror_cad.occt.plate_step import write_plate

        made = self.as_made
        write_plate(Path(path), made.plate, made.surface, made._text)

    def export_step_apart(self, path: str | Path) -> None:
        """Write what `export_step` writes in the process that reads CAD files: this one does without the kernel.

        Parameters
        ----------
        path : str or Path
            Of the file.

        Raises
        ------
        WriteError, SolidError
            As `export_step`.
        """
        made = self.as_made
        write_apart(Path(path), *made._face_arrays, made.outline, self.spec.glass.thickness_mm, made._text)

    def export_steps_apart(self, step: Path, sheet: Path, sides_mm: float, meanwhile: Callable[[], None]) -> PlateFiles:
        """Write what `export_step` and `export_surface_step` write in the process that reads CAD files, and read it back there.

        Parameters
        ----------
        step, sheet : Path
            Of the files.
        sides_mm : float
            Deflection of the triangles that the plate's sides are read as.
        meanwhile : callable
            Called here while that process works.

        Returns
        -------
        PlateFiles

        Raises
        ------
        WriteError, SolidError
            As those do.
        FileError
            Where a file cannot be read again.
        """
        made = self.as_made
        area, volume, *read = write_and_read_apart(step, sheet, *made._face_arrays, made.outline, self.spec.glass.thickness_mm,
                                                   made.sheet_box(), made._text, sides_mm, meanwhile)
        return PlateFiles(area, volume, *(ReadStep.of(each) for each in read))

    @property
    def _face_arrays(self) -> tuple[BSplineArrays, BSplineArrays]:
        """Of the optical face and the other one."""
        optical, other = ((each.degree_u, each.degree_v, each.knots_u, each.knots_v, each.poles, each.weights)
                          for each in (self.surface, self._other_face[0]))
        return optical, other

    @property
    def _text(self) -> PlateText:
        part = self.spec.part
        return PlateText(self.spec.name, self.spec.glass.reflecting, part.hand, part.transition_mm, self.transition)

    def export_surface_step(self, path: str | Path) -> None:
        """Write the untrimmed sheet, `surface_margin_mm` beyond the outline, with the trim curve as a wire.

        Parameters
        ----------
        path : str or Path
            Of the file.

        Raises
        ------
        WriteError, SolidError
            Where the file cannot be written, or the plate cannot be.
        """
        from mirror_cad.occt.plate_step import write_sheet

        made = self.as_made
        write_sheet(Path(path), made.plate, made.surface, made.sheet_box(), made._text)

    def export_stl(self, path: str | Path, deflection_mm: float | None = None) -> None:
        """Write the plate as binary STL, no facet farther than the deflection from its face.

        Parameters
        ----------
        path : str or Path
            Of the file.
        deflection_mm : float, optional
            Absolute; without it that of the specification.

        Raises
        ------
        WriteError
            For a deflection that is not positive and finite or that no STL of this plate can hold, and where the file cannot be
            written.
        SolidError
            Where the plate cannot be.
        """
        _ = self.as_made.plate  # which must be a solid
        self.export_stl_apart(path, deflection_mm)

    def export_stl_apart(self, path: str | Path, deflection_mm: float | None = None) -> None:
        """Write what `export_stl` writes, without the kernel, which says whether the plate is a solid.

        Parameters
        ----------
        path : str or Path
            Of the file.
        deflection_mm : float, optional
            As for `export_stl`.

        Raises
        ------
        WriteError, SolidError
            As `export_stl`, but that the plate is no solid goes unseen.
        """
        from mirror_cad.plate_mesh import plate_mesh
        from mirror_cad.stl_file import write_mesh

        made = self.as_made
        wanted = self.spec.export.stl_deflection_mm if deflection_mm is None else deflection_mm
        if not 0.0 < wanted < np.inf:
            raise WriteError(f"{path}: a deflection of {wanted:g} mm cannot be held: it must be finite and above 0")
        rounding = STL_ROUNDING * float(np.abs(made._other_face[0].poles).max())
        if wanted < 2.0 * rounding:
            raise WriteError(f"{path}: a deflection of {wanted:g} mm cannot be held: STL rounds the corners of this plate to "
                             f"{rounding:.1g} mm; ask for {2.0 * rounding:.1g} mm or more")
        try:
            mesh = plate_mesh(made.front, made.back, made.outline, wanted - rounding)
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
        """Points and normals on a regular grid inside the outline; the grid holds the origin.

        Parameters
        ----------
        pitch_mm : float
            Along x and y.

        Returns
        -------
        ndarray
            (n, 6): x, y, z in mm, and the unit normal.
        """
        from mirror_cad.surfaces.differential import normals

        x_min, x_max, y_min, y_max = self.box
        x, y = np.meshgrid(pitch_mm * np.arange(np.ceil(x_min / pitch_mm), x_max / pitch_mm + 1e-9),
                           pitch_mm * np.arange(np.ceil(y_min / pitch_mm), y_max / pitch_mm + 1e-9))
        inside = self.outline.contains(x, y)
        d = self.surface.derivatives(x[inside], y[inside])
        return np.hstack([d["s"], normals(d["u"], d["v"])])

    def deviation(self, read_back: BSplineSurface | None = None, stl: SurfaceMesh | None = None) -> Deviation:
        """Realised against designed curvature, stage by stage, on the optical face as read back from the files.

        Parameters
        ----------
        read_back : BSplineSurface, optional
            The optical face as read from STEP, in the frame of the design: of a right-hand mirror reflected again.
        stl : SurfaceMesh, optional
            The plate as read from STL, likewise. Without both, the files are written to a temporary folder and read back here.

        Raises
        ------
        WriteError, SolidError
            Where a file cannot be written, or the plate cannot be.
        """
        if read_back is None or stl is None:
            from mirror_cad.occt.step import read_step
            from mirror_cad.stl_file import read_stl

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
                              self.spec.limits.curvature_percent, of_laws=self.from_view is None)

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
