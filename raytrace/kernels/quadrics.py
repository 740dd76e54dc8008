"""Rays to planes, spheres and cylinders, in closed form and float64: one trimmed face, or many in a tree."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.compiled import compiled, inner
from raytrace.kernels.outcomes import BEHIND, HIT, INVALID, NEAREST_MM, OUTSIDE
from raytrace.kernels.trees import Tree, entered, inverse, put_children
from raytrace.kernels.trimming import Strips, odd_to_the_right

Array = NDArray[np.float64]
Index = NDArray[np.int64]

TURN = 2.0 * np.pi
SEAM = 1e-9  # radians beside a seam or pole; loops of other programs miss these by 1e-12 and more
PLANE, SPHERE, CYLINDER = range(3)


class QuadricArrays(NamedTuple):
    """One trimmed quadric.

    Attributes
    ----------
    kind : PLANE, SPHERE or CYLINDER.
    radius : mm.
    centre : (3,), mm.
    axes : (3, 3), the rows are its own x, y and z.
    outward : 1 or −1, whether the quadric's own outer side is that of the face.
    one_sided : whether only the outward side reflects.
    u_low, u_high : between which the trimming lies in u, which may be several turns.
    strips : of the trimming.
    """

    kind: int
    radius: float
    centre: Array
    axes: Array
    outward: float
    one_sided: bool
    u_low: float
    u_high: float
    strips: Strips


# Columns of the many quadrics' counts and sizes.
KIND, ONE_SIDED, STRIPS_FROM, STRIPS_TO, EDGES_FROM, EDGES_TO = range(6)
RADIUS, OUTWARD, LOW, INVERSE_HEIGHT, U_LOW, U_HIGH, CENTRE, AXES = 0, 1, 2, 3, 4, 5, 6, 9


class Quadrics(NamedTuple):
    """Many trimmed quadrics, in the order of their tree's leaves.

    Attributes
    ----------
    tree : of their boxes.
    counts, sizes : (f, 6) and (f, 18), of the quadrics, see the columns.
    first, edges, interior : of the trimmings, one after the other, as in `Strips`.
    """

    tree: Tree
    counts: Index
    sizes: Array
    first: Index
    edges: Array
    interior: Array


@inner()
def _within(strips, u, v):
    """Even-odd rule on the trimming polygon, whose upper end counts; an interior span says it at once."""
    first, low, inverse_height, interior = strips.first, strips.low, strips.inverse_height, strips.interior
    if not low <= v <= low + (first.size - 1) / inverse_height:
        return False
    strip = int((v - low) * inverse_height)
    if strip >= first.size - 1:
        return False
    if interior[strip, 0] < u < interior[strip, 1]:
        return True
    return odd_to_the_right(strips.edges, first[strip], first[strip + 1], u, v)


@inner()
def on_face(kind, strips, u_low, u_high, u, v):
    """Whether a place lies inside the loops, whose u may run over several turns."""
    if kind == PLANE:
        return _within(strips, u, v)
    u = u_low + (u - u_low) % TURN
    # A seam is no edge, nor is a pole: what lies beside it is judged by what lies a little farther beside.
    if u_high - u_low >= TURN - SEAM:
        u = min(max(u, u_low + SEAM), u_low + TURN - SEAM)
    if kind == SPHERE:
        v = min(max(v, -0.5 * np.pi + SEAM), 0.5 * np.pi - SEAM)
    while u <= u_high:
        if _within(strips, u, v):
            return True
        u += TURN
    return False


@inner()
def _roots(kind, radius, ox, oy, oz, dx, dy, dz):
    """Distances along a ray at which it meets the whole quadric, nearer first, NaN for none; in the quadric's frame.

    For sphere and cylinder the discriminant is taken from the ray's distance q to the centre or axis, (R − q)(R + q): as
    the square of a root's difference it would lose half of the digits where the ray grazes.
    """
    if kind == PLANE:
        return (-oz / dz if dz != 0.0 else np.nan), np.nan
    if kind == CYLINDER:
        oz = dz = 0.0
    squared = dx * dx + dy * dy + dz * dz
    middle = -(ox * dx + oy * dy + oz * dz) / squared
    fx, fy, fz = ox + middle * dx, oy + middle * dy, oz + middle * dz
    foot = np.sqrt(fx * fx + fy * fy + fz * fz)
    half = np.sqrt((radius - foot) * (radius + foot) / squared)
    start = np.sqrt(ox * ox + oy * oy + oz * oz)
    # The root nearer to zero from the product of both: as a difference it would lose digits next to the surface.
    far = middle + half if middle >= 0.0 else middle - half
    near = (start - radius) * (start + radius) / squared / far if far != 0.0 else 0.0
    return min(near, far), max(near, far)


@inner()
def _meet_one(face, n, origins, units, results):
    """What ray n meets of one quadric, into its results where it is nearer than what stands there."""
    kind, radius, centre, axes, outward = face.kind, face.radius, face.centre, face.axes, face.outward
    status, points, normals, reflected, distances = results
    k = 3 * n
    o = 0 if origins.size == 3 else k
    x_x, x_y, x_z = axes[0, 0], axes[0, 1], axes[0, 2]
    y_x, y_y, y_z = axes[1, 0], axes[1, 1], axes[1, 2]
    z_x, z_y, z_z = axes[2, 0], axes[2, 1], axes[2, 2]
    px, py, pz = origins[o] - centre[0], origins[o + 1] - centre[1], origins[o + 2] - centre[2]
    ex, ey, ez = units[k], units[k + 1], units[k + 2]
    ox, oy, oz = x_x * px + x_y * py + x_z * pz, y_x * px + y_y * py + y_z * pz, z_x * px + z_y * py + z_z * pz
    dx, dy, dz = x_x * ex + x_y * ey + x_z * ez, y_x * ex + y_y * ey + y_z * ez, z_x * ex + z_y * ey + z_z * ez
    nearer, farther = _roots(kind, radius, ox, oy, oz, dx, dy, dz)
    for root in range(2):
        t = nearer if root == 0 else farther
        # A NaN, a ray without this root, passes no comparison; one that has met nothing has met it at NaN.
        if not t > NEAREST_MM or t >= distances[n]:
            continue
        # Brought onto the quadric: place (qx, qy, qz), its outer normal (mx, my, mz), and its parameters.
        qx, qy, qz = ox + t * dx, oy + t * dy, oz + t * dz
        if kind == PLANE:
            mx, my, mz, qz, u, v = 0.0, 0.0, 1.0, 0.0, qx, qy
        elif kind == SPHERE:
            length = np.sqrt(qx * qx + qy * qy + qz * qz)
            mx, my, mz = qx / length, qy / length, qz / length
            u, v = np.arctan2(qy, qx), np.arctan2(qz, np.sqrt(qx * qx + qy * qy))
            qx, qy, qz = radius * mx, radius * my, radius * mz
        else:
            length = np.sqrt(qx * qx + qy * qy)
            mx, my, mz = qx / length, qy / length, 0.0
            u, v = np.arctan2(qy, qx), qz
            qx, qy = radius * mx, radius * my
        if not on_face(kind, face.strips, face.u_low, face.u_high, u, v):
            continue
        distances[n] = t
        nx, ny, nz = x_x * mx + y_x * my + z_x * mz, x_y * mx + y_y * my + z_y * mz, x_z * mx + y_z * my + z_z * mz
        along = outward * (ex * nx + ey * ny + ez * nz)
        if face.one_sided and along >= 0.0:
            status[n] = BEHIND
            for c in range(k, k + 3):
                points[c] = normals[c] = reflected[c] = np.nan
            break
        side = -outward if along > 0.0 else outward
        nx, ny, nz = side * nx, side * ny, side * nz
        twice = 2.0 * abs(along)
        status[n] = HIT
        points[k] = centre[0] + x_x * qx + y_x * qy + z_x * qz
        points[k + 1] = centre[1] + x_y * qx + y_y * qy + z_y * qz
        points[k + 2] = centre[2] + x_z * qx + y_z * qy + z_z * qz
        normals[k], normals[k + 1], normals[k + 2] = nx, ny, nz
        reflected[k], reflected[k + 1], reflected[k + 2] = ex + twice * nx, ey + twice * ny, ez + twice * nz
        break


@compiled(nogil=True, _nrt=False)
def _begin(valid, results):
    """Results of rays that have met nothing."""
    status, points, normals, reflected, distances = results
    for n in range(status.size):
        status[n], distances[n] = (OUTSIDE if valid[n] else INVALID), np.nan
        for c in range(3 * n, 3 * n + 3):
            points[c] = normals[c] = reflected[c] = np.nan


@compiled(nogil=True, _nrt=False)
def meet(face, first, origins, units, valid, results):
    """Trace rays to where they first meet a face inside its loops.

    Parameters
    ----------
    face : QuadricArrays.
    first : whether results are new; else a ray keeps what it has met before, unless it meets this nearer.
    origins, units : (3,) or (3n,), mm, and (3n,), unit, flat.
    valid : (n,), which rays are rays; the others become INVALID.
    results : Results of n rays.
    """
    if first:
        _begin(valid, results)
    for n in range(valid.size):
        if valid[n]:
            _meet_one(face, n, origins, units, results)


@compiled(inline="always")
def _face(quadrics, f):
    """One of many quadrics."""
    counts, sizes = quadrics.counts[f], quadrics.sizes[f]
    a, b = counts[STRIPS_FROM], counts[STRIPS_TO]
    # A trimming has one more first edge than strips, and f of them stand before this one.
    strips = Strips(quadrics.first[a + f:b + f + 1], quadrics.edges[counts[EDGES_FROM]:counts[EDGES_TO]], sizes[LOW],
                    sizes[INVERSE_HEIGHT], quadrics.interior[a:b])
    return QuadricArrays(counts[KIND], sizes[RADIUS], sizes[CENTRE:CENTRE + 3], sizes[AXES:AXES + 9].reshape(3, 3),
                         sizes[OUTWARD], counts[ONE_SIDED] != 0, sizes[U_LOW], sizes[U_HIGH], strips)


@compiled(nogil=True, _nrt=False)
def meet_first(quadrics, stack, entries, origins, units, valid, results):
    """Trace rays to where they first meet any of many faces: the nearer of two boxes first, none that begins beyond that.

    Parameters
    ----------
    quadrics : Quadrics.
    stack, entries : (NODES,), working arrays, int64 and float64.
    origins, units, valid, results : as in `meet`; results are new.
    """
    nodes, links, distances = quadrics.tree.boxes, quadrics.tree.links, results.distances
    _begin(valid, results)
    for n in range(valid.size):
        if not valid[n]:
            continue
        k, o = 3 * n, 0 if origins.size == 3 else 3 * n
        ox, oy, oz = origins[o], origins[o + 1], origins[o + 2]
        ix, iy, iz = inverse(units[k]), inverse(units[k + 1]), inverse(units[k + 2])
        stack[0], entries[0] = 0, entered(nodes, 0, ox, oy, oz, ix, iy, iz, np.inf)
        left = 1 if entries[0] < np.inf else 0
        while left > 0:
            left -= 1
            if entries[left] >= distances[n]:  # never where nothing has been met
                continue
            child, size = links[stack[left], 0], links[stack[left], 1]
            if size > 0:
                for f in range(child, child + size):
                    _meet_one(_face(quadrics, f), n, origins, units, results)
                continue
            farthest = distances[n] if distances[n] < np.inf else np.inf
            left = put_children(nodes, child, ox, oy, oz, ix, iy, iz, farthest, stack, entries, left)
