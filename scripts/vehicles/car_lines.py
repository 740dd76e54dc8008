"""A car's main dimensions in, its fair lines and its two domes (lower body and cabin) as grids of points out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from .domes import End, dome, half_plan
from .wheels import Wheel

Array = NDArray[np.float64]
Curve = tuple[tuple[float, ...], tuple[float, ...]]

@dataclass(frozen=True, slots=True)
class Car:
    """The dimensions of a car [mm, degrees]; x is counted from the front end rearwards, z from the ground."""

    length: float
    width: float
    height: float
    wheelbase: float
    front_overhang: float
    clearance: float
    wheel: Wheel
    nose_height: float  # of the bonnet's leading edge
    cowl: tuple[float, float]  # x, z of the windscreen's foot on the median plane
    screen_rake: float  # of the windscreen, from the horizontal
    deck: tuple[float, float]  # x, z of the rear window's foot on the median plane
    back_rake: float
    tumblehome: float  # of the side windows, from the vertical
    shelf: float  # the cabin's foot inside the greatest half width
    roof_peak: float  # x
    roof_fall: float  # of the roof a metre before and behind its peak
    shoulder: float  # how far the lower body's upper edge is rounded, from where wall and top would meet
    gutter: float  # the same of the roof
    crease: float  # share of the flank's height at which its crease lies
    nose: Curve  # the front end's section: heights z, x there
    tail: Curve  # heights, distances before the rear end
    side: Curve  # heights, distances inside the greatest half width
    front: End
    rear: End
    screen: End
    back: End
    glass: tuple[float, float, float]  # z of the upper edges of windscreen, side windows (before the roof's fall), rear window
    flare: float  # how far the wings bulge about the wheels
    bulge: float  # of the bonnet


class Lines:
    """The curves of a car that its faces and outlines are made from."""

    def __init__(self, car: Car) -> None:
        self.car = car
        self.half = 0.5 * car.width
        self.axles = (car.front_overhang, car.front_overhang + car.wheelbase)
        self.nose = PchipInterpolator(*car.nose)
        self.tail = PchipInterpolator(car.tail[0], car.length - np.array(car.tail[1]))
        self.side = PchipInterpolator(car.side[0], self.half - car.flare - np.array(car.side[1]))
        (cx, cz), (dx, dz) = car.cowl, car.deck
        t = np.array([-0.2, 0.0, 0.1, 0.25, 0.5, 0.75, 1.0])
        rise = np.where(t < 0.0, 2.2 * t, 1.0 - np.maximum(1.0 - t, 0.0) ** 2.2)
        self.belt = PchipInterpolator(
            np.concatenate([t * cx, [cx + 600.0, 0.5 * (cx + dx) + 300.0, dx, car.length + 100.0, car.length + 400.0]]),
            np.concatenate([car.nose_height + (cz - car.nose_height) * rise,
                            [cz + 12.0, cz + 0.55 * (dz - cz), dz, dz - 22.0, dz - 60.0]]))

    def bonnet(self, x: Array, y: Array) -> Array:
        """Height of the lower body's top."""
        q = y / self.half
        bulge = self.car.bulge * np.exp(-(((np.abs(y) - 0.52 * self.half) / 120.0) ** 2))
        fade = 1.0 / (1.0 + np.exp((x - self.car.cowl[0] - 250.0) / 60.0))
        return self.belt(x) - 38.0 * q**2 - 42.0 * q**4 + bulge * fade

    def roof(self, x: Array, y: Array) -> Array:
        """Height of the cabin's top."""
        car = self.car
        return car.height - car.roof_fall * ((x - car.roof_peak) / 1000.0) ** 2 - 52.0 * (y / (0.7 * self.half)) ** 2

    def cabin_half(self, z: Array | float) -> Array:
        """Half width of the cabin."""
        rise = np.asarray(z, dtype=np.float64) - self.car.cowl[1]
        lean = np.tan(np.radians(self.car.tumblehome))
        return self.half - self.car.shelf - lean * rise - 60.0 * np.maximum(rise / 500.0, 0.0) ** 2

    def screen(self, z: Array | float, q: float = 0.0) -> Array:
        """x of the windscreen at a share q of the cabin's half width."""
        rise = np.asarray(z, dtype=np.float64) - self.car.cowl[1]
        lean = 1.0 / np.tan(np.radians(self.car.screen_rake))
        return self.car.cowl[0] + lean * rise + 40.0 * (rise / 400.0) ** 2 + self.car.screen.recess(q)

    def back(self, z: Array | float, q: float = 0.0) -> Array:
        """x of the rear window at a share q of the cabin's half width."""
        rise = np.asarray(z, dtype=np.float64) - self.car.deck[1]
        lean = 1.0 / np.tan(np.radians(self.car.back_rake))
        return self.car.deck[0] - lean * rise - 25.0 * (rise / 400.0) ** 2 - self.car.back.recess(q)


def lower_grid(lines: Lines) -> Array:
    """The dome up to bonnet, shoulder and boot: points (AROUND, n, 3)."""
    car = lines.car
    low, high = car.clearance, max(car.deck[1], car.cowl[1]) + 120.0

    def plan(z: float) -> Array:
        return half_plan(float(lines.nose(z)), float(lines.tail(z)), float(lines.side(z)), (car.front, car.rear))

    def swell(points: Array, share: Array) -> Array:
        x, y, z = points.T
        reach = np.hypot(x - np.array(lines.axles)[:, None], z - car.wheel.radius) - car.wheel.radius - 60.0
        flare = car.flare * np.exp(-((np.maximum(reach, 0.0) / 140.0) ** 2) - (np.minimum(reach, 0.0) / 200.0) ** 2).sum(axis=0)
        barrel = -y * 0.022 * ((x - 0.52 * car.length) / (0.5 * car.length)) ** 2
        step = 6.0 * (1.0 + np.tanh((share - car.crease) / 0.045)) * np.clip((x - 500.0) / 700.0, 0.0, 1.0)
        return barrel + (flare - step) * np.clip((y - 300.0) / 400.0, 0.0, 1.0)

    under = End(300.0, 2.6, 30.0)  # of the ring under the cabin where the dome ends
    ring = half_plan(car.cowl[0] + 170.0, car.deck[0] - 170.0, lines.half - car.shelf - 170.0, (under, under))
    return dome(plan, swell, lines.bonnet, (low, high), ring, car.shoulder, np.linspace(0.0, 1.0, 14),
                np.array([0.0, 0.08, 0.2, 0.36, 0.55, 0.77, 1.0]))


def cabin_grid(lines: Lines) -> Array:
    """The dome of the cabin from inside the lower body up and onto the roof: points (AROUND, n, 3)."""
    car = lines.car
    low, high = car.cowl[1] - 120.0, car.height + 40.0

    def plan(z: float) -> Array:
        return half_plan(float(lines.screen(z)), float(lines.back(z)), float(lines.cabin_half(z)), (car.screen, car.back))

    def swell(points: Array, share: Array) -> Array:
        x, y, _ = points.T
        return -y * 0.035 * np.clip((x - car.roof_peak) / 1500.0, -0.35, None) ** 2

    ring = plan(car.height - 60.0)
    middle = 0.5 * (ring[0, 0] + ring[-1, 0])
    ring = np.column_stack([middle + (ring[:, 0] - middle) * 0.70, ring[:, 1] * 0.55])
    return dome(plan, swell, lines.roof, (low, high), ring, car.gutter, np.linspace(0.0, 1.0, 7),
                np.array([0.0, 0.25, 0.6, 1.0]))
