"""Normals of the smooth surface that a mesh's vertices lie on: one a facet's corner, and between them at any point.

A facet's own normal is off by a first-order error in the size of the facets; these are of second order, up to the rim.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from mirror_cad.mesh import SurfaceMesh
from raytrace.kernels.compiled import compiled
from raytrace.parallel import parallel_for

Array = NDArray[np.float64]

CREASE_DEG = 30.0  # facets that meet at a sharper angle are two surfaces: a mirror's facets turn by a degree or two
MAX_NEIGHBOURS = 48  # of a vertex, with itself: two rings hold some 18; a fan's centre may have thousands
MIN_NEIGHBOURS = 6  # one more than a quadric has coefficients
MAX_RINGS = 4  # two are enough but at a rim's corners
# Of a pivot in the quadric's equations, whose diagonal is 1: below it the neighbours do not determine the quadric.
MIN_PIVOT = 1e-7


def corner_normals(mesh: SurfaceMesh, crease_deg: float = CREASE_DEG) -> Array:
    """Estimate the normals of the smooth surface that a mesh stands for, at the three corners of every facet.

    At each vertex the surface is taken to be the quadric z = g·p + p·A·p/2 through the vertex that comes closest, with
    weights 1/distance², to its neighbours and theirs; its normal at the vertex has an error of second order in the distance
    of the vertices, also at a rim and for irregular triangles, where means of facet normals have one of first order. Facets
    that meet at more than `crease_deg`, at a side that not exactly two share, or that are wound against each other, are not
    neighbours. Where the neighbours are too few for a quadric: the mean of the facet normals, weighted by
    sin(angle)/(product of the two sides), which is exact on a sphere.

    Parameters
    ----------
    mesh : of m facets.
    crease_deg : degrees.

    Returns
    -------
    (m, 3, 3), unit, on the side of the facet's own normal; zero for facets without area.

    References
    ----------
    Cazals and Pouget, Estimating differential quantities using polynomial fitting of osculating jets (2005);
    Max, Weights for computing vertex normals from facet normals (1999).
    """
    facet = mesh.facet_normals()
    node, first, neighbours = _smooth_graph(mesh.faces, facet, crease_deg)
    n = len(first) - 1
    weighted = _max_weights(mesh)[:, :, None] * facet[:, None, :]
    mean = np.stack([np.bincount(node.ravel(), weighted[:, :, c].ravel(), n) for c in range(3)], axis=1)
    length = np.linalg.norm(mean, axis=1, keepdims=True)
    mean = np.divide(mean, length, out=np.zeros_like(mean), where=length > 0.0)
    vertices = np.empty((n, 3))
    vertices[node.ravel()] = mesh.vertices[mesh.faces.ravel()]
    normals = np.empty((n, 3))
    least_cosine = np.cos(np.radians(crease_deg))
    parallel_for(lambda i, j: _quadric_normals(i, j, vertices, mean, first, neighbours, least_cosine, normals), n)
    result: Array = normals[node]
    return result


def _smooth_graph(faces: NDArray[np.int32], facet: Array, crease_deg: float,
                  ) -> tuple[NDArray[np.int32], NDArray[np.int64], NDArray[np.int32]]:
    """Nodes, each a vertex as one smooth surface has it: the node of every corner (m, 3), and the nodes' neighbours.

    Neighbours of node i: `neighbours[first[i]:first[i + 1]]`.
    """
    following = np.array([1, 2, 0])
    start, end = faces.ravel(), faces[:, following].ravel()  # side 3f + k goes from corner k of facet f to the next one
    low, high = np.minimum(start, end), np.maximum(start, end)
    order = np.lexsort((high, low))
    low, high = low[order], high[order]
    firsts = np.flatnonzero(np.concatenate([[True], (low[1:] != low[:-1]) | (high[1:] != high[:-1])]))
    pairs = firsts[np.diff(np.append(firsts, len(low))) == 2]
    one, other = order[pairs], order[pairs + 1]
    smooth = np.einsum("ij,ij->i", facet[one // 3], facet[other // 3]) >= np.cos(np.radians(crease_deg))
    smooth &= start[one] == end[other]
    one, other = one[smooth], other[smooth]
    after_one, after_other = one - one % 3 + following[one % 3], other - other % 3 + following[other % 3]
    # The start of a side is the end of the one that runs against it.
    rows, columns = np.concatenate([one, after_one]), np.concatenate([after_other, other])
    joined = csr_array((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(3 * len(faces), 3 * len(faces)))
    n, label = connected_components(joined, directed=False)
    node: NDArray[np.int32] = label.reshape(-1, 3).astype(np.int32)
    a, b = node.ravel(), node[:, following].ravel()
    ends = np.concatenate([a, b]), np.concatenate([b, a])
    graph = csr_array((np.ones(len(ends[0]), dtype=np.int8), ends), shape=(n, n))
    return node, graph.indptr.astype(np.int64), graph.indices.astype(np.int32)


def _max_weights(mesh: SurfaceMesh) -> Array:
    """sin(angle)/(product of the two sides) at every corner, (m, 3); zero for facets without area."""
    corners = mesh.vertices[mesh.faces]
    sides = np.roll(corners, -1, axis=1) - corners
    square = np.einsum("fkc,fkc->fk", sides, sides)
    double_area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)[:, None]
    product = square * np.roll(square, 1, axis=1)
    result: Array = np.divide(double_area, product, out=np.zeros_like(product), where=product > 0.0)
    return result


@compiled(nogil=True)
def _quadric_normals(start, stop, vertices, mean, first, neighbours, least_cosine, normals):
    """The normal of the quadric at the nodes start … stop.

    `mean` where there is none, or where it turns away from it by a crease.
    """
    for i in range(start, stop):
        near = np.empty(MAX_NEIGHBOURS, dtype=np.int32)
        near[0] = i
        count, ring = 1, 0
        for _ in range(MAX_RINGS):
            last, ring = ring, count
            for m in range(last, ring):
                for k in range(first[near[m]], first[near[m] + 1]):
                    known = count == MAX_NEIGHBOURS
                    for other in range(count):
                        known = known or near[other] == neighbours[k]
                    if not known:
                        near[count] = neighbours[k]
                        count += 1
            if last > 0 and count > MIN_NEIGHBOURS:
                break
        nx, ny, nz = mean[i, 0], mean[i, 1], mean[i, 2]
        normals[i, 0], normals[i, 1], normals[i, 2] = nx, ny, nz
        if count <= MIN_NEIGHBOURS or not nx * nx + ny * ny + nz * nz > 0.5:
            continue
        # Axes in the plane across the mean normal, turned to the long and the short direction of the neighbours.
        ax, ay, az = (0.0, nz, -ny) if abs(nx) <= abs(ny) else (-nz, 0.0, nx)
        size = np.sqrt(ax * ax + ay * ay + az * az)
        ax, ay, az = ax / size, ay / size, az / size
        bx, by, bz = ny * az - nz * ay, nz * ax - nx * az, nx * ay - ny * ax
        local = np.empty((count, 3))
        xx = xy = yy = 0.0
        for m in range(count):
            dx = vertices[near[m], 0] - vertices[i, 0]
            dy = vertices[near[m], 1] - vertices[i, 1]
            dz = vertices[near[m], 2] - vertices[i, 2]
            p, q = dx * ax + dy * ay + dz * az, dx * bx + dy * by + dz * bz
            local[m, 0], local[m, 1], local[m, 2] = p, q, dx * nx + dy * ny + dz * nz
            xx, xy, yy = xx + p * p, xy + p * q, yy + q * q
        turn = 0.5 * np.arctan2(2.0 * xy, xx - yy)
        cosine, sine = np.cos(turn), np.sin(turn)
        # Weighted normal equations of x, y, x²/2, xy, y²/2, then z.
        sums, row = np.zeros((5, 6)), np.empty(6)
        for m in range(count):
            p, q = local[m, 0], local[m, 1]
            x, y, z = cosine * p + sine * q, cosine * q - sine * p, local[m, 2]
            square = x * x + y * y + z * z
            if square == 0.0:
                continue
            row[0], row[1], row[2], row[3], row[4], row[5] = x, y, 0.5 * x * x, x * y, 0.5 * y * y, z
            for r in range(5):
                for c in range(r, 6):
                    sums[r, c] += row[r] * row[c] / square
        # Scaled to a diagonal of 1, and eliminated without pivoting: the matrix is symmetric and positive.
        scale = np.empty(5)
        solved = True
        for r in range(5):
            solved = solved and sums[r, r] > 0.0
            scale[r] = 1.0 / np.sqrt(sums[r, r])
        for r in range(5):
            for c in range(r, 5):
                sums[r, c] *= scale[r] * scale[c]
            sums[r, 5] *= scale[r]
        for r in range(5):
            solved = solved and sums[r, r] > MIN_PIVOT
            for s in range(r + 1, 5):
                factor = sums[r, s] / sums[r, r]
                for c in range(s, 6):
                    sums[s, c] -= factor * sums[r, c]
        if not solved:
            continue
        for r in range(4, -1, -1):
            for c in range(r + 1, 5):
                sums[r, 5] -= sums[r, c] * sums[c, 5]
            sums[r, 5] /= sums[r, r]
        x, y = sums[0, 5] * scale[0], sums[1, 5] * scale[1]
        p, q = cosine * x - sine * y, sine * x + cosine * y
        size = np.sqrt(1.0 + p * p + q * q)
        if not 1.0 / size >= least_cosine:
            continue
        normals[i, 0] = (nx - p * ax - q * bx) / size
        normals[i, 1] = (ny - p * ay - q * by) / size
        normals[i, 2] = (nz - p * az - q * bz) / size


def interpolated_normals(corners: Array, triangle: NDArray[np.int32], u: Array, v: Array) -> Array:
    """Interpolate normals between the corners of facets: (1 − u − v)·n0 + u·n1 + v·n2 at hits, normalised.

    Parameters
    ----------
    corners : (m, 3, 3), as `corner_normals` gives them.
    triangle, u, v : (n,), as in `raytrace.embree.Hits`.

    Returns
    -------
    (n, 3), unit; zero where triangle is −1.
    """
    result = np.empty((len(triangle), 3))
    parallel_for(lambda i, j: _interpolate(corners, triangle[i:j], u[i:j], v[i:j], result[i:j]), len(triangle))
    return result


@compiled(nogil=True)
def _interpolate(corners, triangle, u, v, result):
    for n in range(triangle.size):
        f = triangle[n]
        x = y = z = 0.0
        if f >= 0:
            a, b, c = 1.0 - u[n] - v[n], u[n], v[n]
            x = a * corners[f, 0, 0] + b * corners[f, 1, 0] + c * corners[f, 2, 0]
            y = a * corners[f, 0, 1] + b * corners[f, 1, 1] + c * corners[f, 2, 1]
            z = a * corners[f, 0, 2] + b * corners[f, 1, 2] + c * corners[f, 2, 2]
        square = x * x + y * y + z * z
        inverse = 1.0 / np.sqrt(square) if square > 0.0 else 0.0
        result[n, 0], result[n, 1], result[n, 2] = x * inverse, y * inverse, z * inverse
