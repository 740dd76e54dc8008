"""What an alignment takes away from a mirror's deviation: the heights that its motion alone would make."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirror_cad.made.inspection import Inspection
from mirror_cad.made.motion import Motion

Array = NDArray[np.float64]

# As given, a mirror lies on its design but for so much of its size: a pose that is farther off is the machine's own, and what
# the motion back takes away is no form.
NEAR = 0.02
STEPS = 12  # of the fixed point for the place that comes to lie over another: each leaves a tilt's share of the error


@dataclass(frozen=True, slots=True, eq=False)
class HiddenForm:
    """Form that the six parts of the alignment's motion hide or may hide, at the lattice's places.

    Attributes
    ----------
    height : ndarray or None
        (k,), mm along z, what the motion takes away: the deviation as the points were given is this and the deviation after
        alignment together. None where they were given in a pose of their own.
    sigma : ndarray or None
        (k,), mm, of height, by the covariance of the motion; None where no best fit was made.
    """

    height: Array | None
    sigma: Array | None


def hidden_form(found: Inspection, given: Motion) -> HiddenForm:
    """Work out what the alignment of an inspection takes away.

    Parameters
    ----------
    found : Inspection
        With its alignment.
    given : Motion
        From the coordinates of the points to the design's, as files have them.
    """
    nominal, places = found.nominal, found.fields.lattice.places
    z, zx, zy = nominal.heights(places[:, 0], places[:, 1])
    return HiddenForm(_taken_away(found, given, places, z), _sigma(found, places, z, zx, zy))


def _taken_away(found: Inspection, given: Motion, places: Array, z: Array) -> Array | None:
    """Heights of the design moved back to where the points were given, less those of the design."""
    # What takes the aligned mirror back to where it was given.
    back = given.rotation @ found.motion.rotation.T
    if found.motion.reflected != given.reflected:
        return None
    shift = given.translation - back @ found.motion.translation
    corners = np.column_stack([places, z])
    if np.abs(corners @ back.T + shift - corners).max() > NEAR * found.nominal.size_mm:
        return None
    at = places.copy()
    for _ in range(STEPS):
        moved = np.column_stack([at, found.nominal.heights(at[:, 0], at[:, 1])[0]]) @ back.T + shift
        at = at + places - moved[:, :2]
    moved = np.column_stack([at, found.nominal.heights(at[:, 0], at[:, 1])[0]]) @ back.T + shift
    result: Array = moved[:, 2] - z
    return result


def _sigma(found: Inspection, places: Array, z: Array, zx: Array, zy: Array) -> Array | None:
    if found.alignment is None:
        return None
    normal = np.stack([-zx, -zy, np.ones_like(zx)], axis=1)  # along z: that of the surface over its own z
    jacobian = np.concatenate([normal, np.cross(np.column_stack([places, z]) - found.alignment.centre, normal)], axis=1)
    variance = np.einsum("ki,ij,kj->k", jacobian, found.alignment.covariance, jacobian)
    result: Array = found.sigma_mm * np.sqrt(np.maximum(variance, 0.0))
    return result
