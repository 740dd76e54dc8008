"""What the driver sees in a made mirror beside the designed one: pictures, measures with their intervals, turns of the rays."""

from __future__ import annotations

import io
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mirror_cad.made.fields import Lattice
from mirror_cad.made.figures import COVERAGE
from mirror_cad.made.measured_surface import measured_surface
from mirror_cad.made.nominal import Nominal
from mirror_cad.made.smoothing import drawn
from mirror_cad.made.spline_fit import SplineFit
from mirror_cad.reflection import reflected_surface
from mirror_cad.spec import MirrorSpec
from mirror_cad.spec.file import load_spec
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_studio.drive.measured import in_use, shown_round
from mirror_studio.drive.mirrors import on_vehicle
from mirror_studio.explore.evaluate import scene_and_asked
from mirror_studio.inspect.reference import Reference
from mirror_studio.viewing_setup import ViewingSetup
from raytrace.image import photograph
from raytrace.measures.registry import Measure, measures_of
from raytrace.placement import Placement
from raytrace.reflector import Reflector
from raytrace.scene.reference import load_picture
from raytrace.surfaces.bspline import BSplineFace
from raytrace.viewing.camera import Frame

Array = NDArray[np.float64]

DRAWS = 24  # mirrors that may be the real one; their scatter knows a sigma to a seventh
SEED = 2
WIDTH_PX = 640
ARCMIN = 10800.0 / np.pi
LENT = "progressive-c"  # the eye and the scene where the design is a file that has none


@dataclass(frozen=True, slots=True)
class SeenMeasure:
    """A registered measure of the designed and of the measured mirror; None where the mirror does not show it.

    Attributes
    ----------
    name, title, unit : str
        As it is registered.
    decimals : int
        As tables show it.
    designed, measured, sigma : float or None
        In that unit.
    """

    name: str
    title: str
    unit: str
    decimals: int
    designed: float | None
    measured: float | None
    sigma: float | None

    @property
    def interval(self) -> tuple[float, float] | None:
        """95 %."""
        if self.measured is None or self.sigma is None:
            return None
        return self.measured - COVERAGE * self.sigma, self.measured + COVERAGE * self.sigma


@dataclass(frozen=True, slots=True, eq=False)
class DriversView:
    """What the driver sees.

    Attributes
    ----------
    measures : tuple
        Of the mirror with the eye where the specification has it, and of it on a vehicle where a scene was given.
    turn, turn_sigma : ndarray
        (k,), arc minutes between the reflected rays of the designed and the measured mirror at the lattice's places.
    designed_jpeg, measured_jpeg : bytes
        The driver's pictures.
    """

    measures: tuple[SeenMeasure, ...]
    turn: Array
    turn_sigma: Array
    designed_jpeg: bytes
    measured_jpeg: bytes


def drivers_view(reference: Reference, lattice: Lattice, smooth: SplineFit, sigma_factor: float, scene: str | None = None,
                 ) -> DriversView:
    """Trace the measured mirror beside the designed one.

    Of a specification whose mirror reflects from its back, measures and pictures are those through the glass, of even thickness
    before either back; the turns of rays and the scatter of measures are the reflecting surface's own.

    Parameters
    ----------
    reference : Reference
        The design.
    lattice : Lattice
        Where turns of rays are told.
    smooth : SplineFit
        The deviation, smoothed.
    sigma_factor : float
        What its sigmas are to be multiplied with.
    scene : str, optional
        A scene's name or file: the measures on its vehicle are taken too.

    Raises
    ------
    MirrorError
        For a scene that is none, or that the mirror cannot be aimed in.
    """
    nominal, rng = reference.nominal, np.random.default_rng(SEED)
    surface = measured_surface(nominal, smooth)
    before, after = _reflector(reference, nominal.surface), _reflector(reference, surface)
    spec = reference.spec or load_spec(LENT)
    low, high = before.bounds
    box = float(low[0]), float(high[0]), float(low[1]), float(high[1])
    setup = ViewingSetup.of(spec, box if reference.mirror is None else reference.mirror.box)
    places = lattice.places * (-1.0 if _is_right(reference) else 1.0, 1.0)
    known = _directions(before, setup.eye, places)
    turned, values = [], []
    for _ in range(DRAWS):
        maybe = _reflector(reference, measured_surface(nominal, replace(smooth, coefficients=drawn(smooth, sigma_factor, rng))))
        values.append(_measures(setup, maybe, reference, scene)[0])
        turned.append(_directions(maybe, setup.eye, places))
    mean = _directions(after, setup.eye, places)
    scatter = np.sqrt(np.mean([np.sum((each - mean) ** 2, axis=1) for each in turned], axis=0) / 2.0)
    shown = _behind_glass(reference, nominal.surface) or before, _behind_glass(reference, surface) or after
    (designed, named), (measured, _) = (_measures(setup, each, reference, scene) for each in shown)
    seen = tuple(SeenMeasure(name, one.title, one.unit, one.decimals, designed[name], measured.get(name),
                             _scatter([each.get(name) for each in values])) for name, one in named.items())
    turn = 2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(mean - known, axis=1), 0.0, 1.0))
    pictures = (_picture(each, setup, spec, box) for each in shown)
    return DriversView(seen, ARCMIN * turn, ARCMIN * scatter, *pictures)


def _is_right(reference: Reference) -> bool:
    return reference.spec is not None and reference.spec.part.hand == "right"


def _reflector(reference: Reference, surface: BSplineSurface) -> Reflector:
    nominal: Nominal = reference.nominal
    reflector = Reflector(BSplineFace(surface, (nominal.rim,)))
    return reflector.moved(Placement.identity("file", "right")) if _is_right(reference) else reflector


def _behind_glass(reference: Reference, surface: BSplineSurface) -> Reflector | None:
    """A surface with the glass that the specification has before it; None where it reflects from its front."""
    mirror = reference.mirror
    if mirror is None or mirror.spec.glass.reflecting == "front":
        return None
    return Reflector.from_mirror(replace(mirror, surface=reflected_surface(surface) if _is_right(reference) else surface))


def _measures(setup: ViewingSetup, reflector: Reflector, reference: Reference, scene: str | None,
              ) -> tuple[dict[str, float | None], dict[str, Measure]]:
    """What is traced of a mirror, and what it is called: measures of the design's sections say nothing of a made one."""
    if scene is None:
        use, twice = setup.in_use(reflector, reference.mirror), False
    else:
        loaded, asked = scene_and_asked(scene)
        driven = on_vehicle(reference.name, reflector, loaded, reference.spec, reference.mirror)
        use, twice = in_use(driven, asked), shown_round(driven.views).twice
    named = {name: one for name, one in measures_of(use).items() if "section" not in name}
    return {name: None if twice and not one.local else one.value(use) for name, one in named.items()}, named


def _scatter(values: list[float | None]) -> float | None:
    found = [value for value in values if value is not None]
    return float(np.std(found, ddof=1)) if len(found) == len(values) else None


def _directions(reflector: Reflector, eye: Array, places: Array) -> Array:
    return reflector.surface.reflected_at(eye, np.ascontiguousarray(places[:, 0]), np.ascontiguousarray(places[:, 1]))[1]


def _picture(reflector: Reflector, setup: ViewingSetup, spec: MirrorSpec, box: tuple[float, float, float, float]) -> bytes:
    from PIL import Image

    frame = Frame.around(box, WIDTH_PX)
    seen, _ = photograph(reflector, frame.camera(setup.eye), setup.scene(load_picture(spec.scene.image), spec))
    file = io.BytesIO()
    Image.fromarray(seen).save(file, format="JPEG", quality=88)
    return file.getvalue()
