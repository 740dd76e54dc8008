"""What all kernels say of a ray, and when they take a place for found."""

from __future__ import annotations

# What becomes of a ray; the values are those of `raytrace.Status`. One that a kernel leaves for the search is LOST until that
# has looked.
HIT, OUTSIDE, BLOCKED, BEHIND, LOST, INVALID = range(6)

# Newton ends where the distance from the surface is rounding: a little more than one of the numbers it is the difference of
# (their sum is taken), or, where it is a little more than that, where the next step does not halve it.
RESIDUAL = 3e-16
ACCEPTED = 30.0  # times RESIDUAL
MAX_STEPS = 16
# A place nearer than this to a ray's origin is the origin itself: rays may start on the surface.
NEAREST_MM = 1e-6
