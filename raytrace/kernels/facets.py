"""The compiled kernels beside Embree: rays go into its float32, and the triangles it names come back as float64 hits.

All lengths in here are local: vertices and origins less the mesh's centre, times a power of two that makes its radius 0.5
to 1, so that float32 neither overflows nor loses digits wherever the mesh is and whatever its size.
"""

from __future__ import annotations

import numpy as np

from raytrace.kernels.compiled import compiled

# What a ray is refused for; `embree` says it in words.
GOOD, BAD_ORIGIN, BAD_DIRECTION, NOT_UNIT = 0, 1, 2, 3
# |d|² − 1 of a direction that counts as unit: wide enough for one that was float32 once.
UNIT_TOLERANCE = 1e-6
# Where no ray can meet anything: it starts outside the mesh's ball and leaves.
NOWHERE = 3.0
# Embree misses rays aimed at a vertex, where float32 finds them outside each of its triangles; they therefore overlap by
# four units of float32's last place of the mesh's radius (0.1 µm for a mirror of 0.4 m). Measured on closed meshes: one
# unit closes every leak.
OVERLAP = 4.0 * 2.0**-23
# Triangles with a corner that would move further than this many overlaps (sharper than 1.8°) stay as they are, or their
# tips would stand out like needles. Next to each other they share their sides exactly, which Embree does not leak at.
MAX_MOVED = 64.0


@compiled(nogil=True)
def overlapping(vertices, faces, corners):
    """Corners (m, 3, 3) float32 of triangles whose sides lie OVERLAP further out, in their own planes.

    A corner of angle α moves by OVERLAP/sin(α/2) along its bisector. Triangles that are no higher than two overlaps stay as
    they are too: their neighbours cover them, and what normal they have is rounding.
    """
    sides, lengths, shift = np.empty((3, 3)), np.empty(3), np.empty((3, 3))
    for m in range(faces.shape[0]):
        for k in range(3):
            a, b = faces[m, k], faces[m, (k + 1) % 3]
            lengths[k] = 0.0
            for c in range(3):
                sides[k, c] = vertices[b, c] - vertices[a, c]
                lengths[k] += sides[k, c] ** 2
            lengths[k] = np.sqrt(lengths[k])
        nx = sides[0, 1] * sides[1, 2] - sides[0, 2] * sides[1, 1]
        ny = sides[0, 2] * sides[1, 0] - sides[0, 0] * sides[1, 2]
        nz = sides[0, 0] * sides[1, 1] - sides[0, 1] * sides[1, 0]
        double_area = np.sqrt(nx * nx + ny * ny + nz * nz)
        moves = double_area > 2.0 * OVERLAP * max(lengths[0], lengths[1], lengths[2])
        if moves:
            for k in range(3):
                out, back = k, (k + 2) % 3  # the sides that leave this corner and come to it
                square = 0.0
                for c in range(3):
                    # (p + q)/sin α puts both sides one unit out, p and q unit and along them away from the triangle.
                    shift[k, c] = (sides[back, c] * lengths[out] - sides[out, c] * lengths[back]) * OVERLAP / double_area
                    square += shift[k, c] ** 2
                moves = moves and square <= (MAX_MOVED * OVERLAP) ** 2
        for k in range(3):
            for c in range(3):
                corners[m, k, c] = vertices[faces[m, k], c] + (shift[k, c] if moves else 0.0)


@compiled(nogil=True, fastmath={"contract"})
def cast(origins, directions, centre, scale, radius, starts, rays):
    """Local rays (n, 3) float32 that start at the ball around the mesh; returns what is wrong with which ray.

    The start is moved along the ray in float64, so that float32 costs 1e-7 of the mesh's size wherever the origin is.
    """
    stride = 0 if origins.shape[0] == 1 else 1
    for n in range(directions.shape[0]):
        k = n * stride
        dx, dy, dz = directions[n, 0], directions[n, 1], directions[n, 2]
        square = dx * dx + dy * dy + dz * dz
        if not abs(square - 1.0) <= UNIT_TOLERANCE:
            finite = np.isfinite(dx) and np.isfinite(dy) and np.isfinite(dz)
            return (NOT_UNIT if finite else BAD_DIRECTION), n
        if not (np.isfinite(origins[k, 0]) and np.isfinite(origins[k, 1]) and np.isfinite(origins[k, 2])):
            return BAD_ORIGIN, n
        x, y, z = (origins[k, 0] - centre[0]) * scale, (origins[k, 1] - centre[1]) * scale, (origins[k, 2] - centre[2]) * scale
        ahead = max(-(x * dx + y * dy + z * dz) - radius, 0.0)
        x, y, z = x + ahead * dx, y + ahead * dy, z + ahead * dz
        # What starts farther from the centre than √2 radii passes the ball, or has passed it.
        if not x * x + y * y + z * z <= 2.25 * radius * radius:
            x, y, z, dx, dy, dz = NOWHERE, 0.0, 0.0, 1.0, 0.0, 0.0
        starts[n, 0], starts[n, 1], starts[n, 2] = x, y, z
        rays[n, 0], rays[n, 1], rays[n, 2] = dx, dy, dz
    return GOOD, 0


@compiled(nogil=True, fastmath={"contract"})
def refine(origins, directions, centre, scale, vertices, faces, found, distance, triangle, u, v):
    """Float64 distance, u and v of each ray on the plane of the triangle that Embree found for it.

    t = n·(v0 − o)/(n·d), n = e1 × e2;   r = o + t·d − v0;   u = (r × e2)·n/n²,   v = (e1 × r)·n/n².
    Where the ray runs along the plane, so that this t is not at the triangle, t is that of its nearest corner.
    """
    stride = 0 if origins.shape[0] == 1 else 1
    unit = 1.0 / scale
    for m in range(directions.shape[0]):
        k = m * stride
        f = found[m]
        triangle[m] = f
        if f < 0:
            distance[m], u[m], v[m] = np.inf, 0.0, 0.0
            continue
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        dx, dy, dz = directions[m, 0], directions[m, 1], directions[m, 2]
        # From the origin to v0, and the two edges.
        sx = vertices[a, 0] - (origins[k, 0] - centre[0]) * scale
        sy = vertices[a, 1] - (origins[k, 1] - centre[1]) * scale
        sz = vertices[a, 2] - (origins[k, 2] - centre[2]) * scale
        px, py, pz = vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1], vertices[b, 2] - vertices[a, 2]
        qx, qy, qz = vertices[c, 0] - vertices[a, 0], vertices[c, 1] - vertices[a, 1], vertices[c, 2] - vertices[a, 2]
        nx, ny, nz = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
        near = sx * dx + sy * dy + sz * dz
        far_p, far_q = near + px * dx + py * dy + pz * dz, near + qx * dx + qy * dy + qz * dz
        low, high = min(near, far_p, far_q), max(near, far_p, far_q)
        slack = 2.0 * MAX_MOVED * OVERLAP  # corners have been moved
        t = (nx * sx + ny * sy + nz * sz) / (nx * dx + ny * dy + nz * dz)
        if not (t >= low - slack and t <= high + slack):  # not a number, too, where the ray lies in the plane
            t = low
        t = max(t, 0.0)
        rx, ry, rz = t * dx - sx, t * dy - sy, t * dz - sz
        square = nx * nx + ny * ny + nz * nz
        inverse = 1.0 / square if square > 0.0 else 0.0
        distance[m] = t * unit
        u[m] = ((ry * qz - rz * qy) * nx + (rz * qx - rx * qz) * ny + (rx * qy - ry * qx) * nz) * inverse
        v[m] = ((py * rz - pz * ry) * nx + (pz * rx - px * rz) * ny + (px * ry - py * rx) * nz) * inverse
