"""One mirror through the whole chain: files, both read back, and the deviation.

The surface of the STEP file is taken from its text and evaluated by scipy.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import NdBSpline

from mirror_cad.design_stages import design
from mirror_cad.deviation import Deviation
from mirror_cad.mirror import Mirror
from mirror_cad.spec.file import validate_spec
from mirror_studio.bench.hard.sheets import Array
from mirror_studio.bench.hard.specs import Spec

SAMPLES = 3000  # at random inside the outline, seed fixed, where curvature and height are compared


@dataclass(frozen=True, eq=False)
class Made:
    """A mirror through the whole chain, its files, and their optical surface as scipy's spline over (x, y)."""

    mirror: Mirror
    deviation: Deviation
    step: Path
    stl: Path
    spline: NdBSpline

    def derivatives(self, x: Array, y: Array) -> tuple[Array, ...]:
        """z_x, z_y, z_xx, z_xy, z_yy of the surface in the STEP text; u = x and v = y is compared elsewhere."""
        orders = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
        return tuple(self.spline(np.stack([x, y], axis=1), nu=order)[:, 2] for order in orders)


def mirror_of(raw: Spec, folder: Path) -> Mirror:
    """The mirror designed to a specification; file names in it are relative to `folder`. Raises: MirrorError."""
    return design(validate_spec({"name": "case"} | raw, folder=folder))


def make(folder: Path, raw: Spec) -> Made:
    """Specification → design → plate → files → read back → deviation. Raises: MirrorError."""
    from mirror_cad.occt.plate_step import told
    from mirror_cad.occt.step import OPTICAL_FACE
    from mirror_cad.outline.files import write_dxf
    from mirror_cad.part21 import read_named_surface
    from mirror_cad.plate_files import ReadStep
    from mirror_cad.stl_file import read_stl
    from mirror_studio.build import checks
    from raytrace.reflector import OBSTACLE_DEFLECTION_MM

    mirror = mirror_of(raw, folder)
    step, sheet, stl, outline = (folder / name for name in ("case.step", "case-surface.step", "case.stl", "case.dxf"))
    mirror.export_step(step)
    mirror.export_surface_step(sheet)
    mirror.export_stl(stl)
    write_dxf(mirror.outline, outline)
    read, of_sheet = (ReadStep.of(told(str(each), OBSTACLE_DEFLECTION_MM)) for each in (step, sheet))
    checks.check_step(step, read, mirror, mirror.plate.volume_mm3)
    checks.check_surface_step(sheet, of_sheet, mirror)
    checks.check_outline(outline, mirror)
    deviation = mirror.deviation(read.named(OPTICAL_FACE).surface, read_stl(stl))
    text = read_named_surface(step, OPTICAL_FACE)
    spline = NdBSpline((text.knots_u, text.knots_v), text.poles, (text.degree_u, text.degree_v))
    return Made(mirror, deviation, step, stl, spline)


def sample_points(mirror: Mirror, breaks: Sequence[float] = (), clear_mm: float = 0.0) -> tuple[Array, Array]:
    """SAMPLES inside the outline and off the breaks."""
    x_min, x_max, y_min, y_max = mirror.box
    rng = np.random.default_rng(20)
    x, y = rng.uniform(x_min, x_max, 4 * SAMPLES), rng.uniform(y_min, y_max, 4 * SAMPLES)
    keep = mirror.outline.contains(x, y)
    for b in breaks:
        keep &= np.abs(x - b) > clear_mm
    return x[keep][:SAMPLES], y[keep][:SAMPLES]
