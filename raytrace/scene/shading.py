"""The compiled kernels of the lit world: where rays land, what sky a direction shows, what light a place sends back.

Arrays in, arrays out, on one thread and without the interpreter's lock. Equations: docs/derivations/daylight.md.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from raytrace.scene.daylight import Daylight
from raytrace.scene.sky import SUN_RADIUS

Array = NDArray[np.float64]

MIN_FACING = 1e-3  # cosine between ray and shading normal: interpolated normals may turn away at an outline
MIN_SLOPES = 0.01  # GGX width α for the sun's highlight: its disc is that wide
MIRRORED_SLOPES = 0.15  # for one that is seen in another body: narrower ones would be specks that few rays find
# At grazing angles a surface reflects all, but none does whose reflectance is 0: Lagarde and de Rousiers 2014 take those from
# 2 % on as real ones.
FULL_FROM = 50.0
SUNNY = 0.25  # cosine towards the sun from which a face looks on sunlit ground
# A disc cannot be seen round by a ray that covers more than it: its edge is soft over this share of its radius at least.
LIMB = 0.15


class Light(NamedTuple):
    """A Daylight as kernels read it.

    Attributes
    ----------
    table, below, harmonics, sun, sun_irradiance, extinction : as in `Daylight`.
    below_sun : (3,), what of `below` the ground owes to the sun's disc.
    """

    table: NDArray[np.float32]
    below: Array
    below_sun: Array
    harmonics: Array
    sun: Array
    sun_irradiance: Array
    extinction: Array

    @staticmethod
    def of(daylight: Daylight) -> Light:
        """That of a Daylight."""
        sun = max(float(daylight.sun[2]), 0.0) * daylight.sun_irradiance
        sky = daylight.irradiance([[0.0, 0.0, 1.0]])[0]
        share = np.divide(sun, sky + sun, out=np.zeros(3), where=sky + sun > 0.0)
        return Light(daylight.table, daylight.below, share * daylight.below, daylight.harmonics, daylight.sun,
                     daylight.sun_irradiance, daylight.extinction)


class Mesh(NamedTuple):
    """All bodies' triangles.

    Attributes
    ----------
    vertices, normals, uv, sky : (n, 3), (n, 3), (n, 2) and (n,), as in `raytrace.scene.parts.Part`.
    faces : (m, 3).
    material : (m,).
    per_mm : (m,), how far (u, v) goes a millimetre.
    """

    vertices: Array
    normals: Array
    uv: Array
    sky: Array
    faces: NDArray[np.int32]
    material: NDArray[np.int32]
    per_mm: Array


class SurfaceInteraction(NamedTuple):
    """Where rays meet the ground or a body: n points, those on the ground first.

    Attributes
    ----------
    ray : (n,), the ray's row.
    point, normal : (n, 3), mm and unit, the normal on the ray's side.
    start : (n, 3), mm, where rays from here begin, clear of the surface.
    distance, radius : (n,), mm, from the ray's start, and of what it covers across itself.
    extent : (n, 2), mm, half of what it covers on the ground along X and Y.
    sky : (n,), the share of it that a body leaves to be seen; 1 on the ground.
    material, uv : (n,) and (n, 2), of bodies.
    covered : (n,), in u and v, of bodies.
    foot : (n, 2), mm, where on the ground light from below comes from.
    ground : (n,), how much of the sky that ground gets; 1 at first.
    to_sun : (n,), cosine towards the sun.
    """

    ray: NDArray[np.int32]
    point: Array
    normal: Array
    start: Array
    distance: Array
    radius: Array
    extent: Array
    sky: Array
    material: NDArray[np.int32]
    uv: Array
    covered: Array
    foot: Array
    ground: Array
    to_sun: Array

    @staticmethod
    def empty(n: int) -> SurfaceInteraction:
        """Arrays for n points."""
        return SurfaceInteraction(
            np.empty(n, dtype=np.int32), np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), np.empty(n), np.empty(n),
            np.empty((n, 2)), np.empty(n), np.empty(n, dtype=np.int32), np.empty((n, 2)), np.empty(n), np.empty((n, 2)),
            np.ones(n), np.empty(n))

    def rows(self, part: slice) -> SurfaceInteraction:
        """Those of a slice, in the same memory."""
        return SurfaceInteraction(*(values[part] for values in self))  # type: ignore[arg-type]


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]  # numba's are
def interactions(origins: Array, directions: Array, spread: Array, radius: Array, distance: Array, triangle: NDArray[np.int32],
           u: Array, v: Array, mesh: Mesh, sun: Array, ground: bool, lift: float, out: SurfaceInteraction) -> tuple[int, int]:
    """Find the points that rays meet, on the ground and on bodies.

    Parameters
    ----------
    origins, directions : (1, 3) or (n, 3), mm, and (n, 3), unit.
    spread, radius : (n,): a ray covers radius + spread·t across, mm, at distance t.
    distance, triangle, u, v : (n,), hits of the bodies, as in `raytrace.embree.Hits`.
    mesh : the bodies.
    sun : (3,), unit, towards it.
    ground : whether there is any, Z = 0.
    lift : mm off the surface that rays from it start at.
    out : what is written.

    Returns
    -------
    on_ground, count : how many points are on the ground, and how many in all.
    """
    count = directions.shape[0]
    one = origins.shape[0] == 1
    on_ground = 0
    if ground:
        for n in range(count):
            dz = directions[n, 2]
            height = origins[0 if one else n, 2]
            if dz < 0.0 < height and -height / dz < distance[n]:
                _ground_place(n, origins[0 if one else n], directions[n], -height / dz, spread[n], radius[n], sun, lift, out,
                              on_ground)
                on_ground += 1
    k = on_ground
    for n in range(count):
        if triangle[n] < 0:
            continue
        o = origins[0 if one else n]
        if ground and directions[n, 2] < 0.0 < o[2] and -o[2] / directions[n, 2] < distance[n]:
            continue
        _body_place(n, o, directions[n], distance[n], triangle[n], u[n], v[n], spread[n], radius[n], mesh, sun, lift, out, k)
        k += 1
    return on_ground, k


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _ground_place(n: int, o: Array, d: Array, t: float, spread: float, radius: float, sun: Array, lift: float,
                  out: SurfaceInteraction, k: int) -> None:
    out.ray[k], out.distance[k], out.radius[k] = n, t, radius + spread * t
    out.point[k, 0], out.point[k, 1], out.point[k, 2] = o[0] + t * d[0], o[1] + t * d[1], 0.0
    out.normal[k, 0], out.normal[k, 1], out.normal[k, 2] = 0.0, 0.0, 1.0
    out.start[k, 0], out.start[k, 1], out.start[k, 2] = out.point[k, 0], out.point[k, 1], lift
    # The cone's cut is as long as 1/|dz| along the ray's bearing, and as wide as the cone.
    level = np.sqrt(d[0] * d[0] + d[1] * d[1])
    cosine, sine = (d[0] / level, d[1] / level) if level > 0.0 else (1.0, 0.0)
    long = out.radius[k] / -d[2]
    out.extent[k, 0] = np.sqrt((long * cosine) ** 2 + (out.radius[k] * sine) ** 2)
    out.extent[k, 1] = np.sqrt((long * sine) ** 2 + (out.radius[k] * cosine) ** 2)
    out.sky[k], out.material[k], out.to_sun[k] = 1.0, -1, sun[2]


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _body_place(n: int, o: Array, d: Array, t: float, f: int, u: float, v: float, spread: float, radius: float, mesh: Mesh,
                sun: Array, lift: float, out: SurfaceInteraction, k: int) -> None:
    a, b, c = mesh.faces[f, 0], mesh.faces[f, 1], mesh.faces[f, 2]
    # Embree's triangles overlap a little: hits beyond a side belong on it.
    u, v = min(max(u, 0.0), 1.0), min(max(v, 0.0), 1.0)
    if u + v > 1.0:
        u, v = u / (u + v), v / (u + v)
    w = 1.0 - u - v
    x, y, z = o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2]
    px, py, pz = (mesh.vertices[b, 0] - mesh.vertices[a, 0], mesh.vertices[b, 1] - mesh.vertices[a, 1],
                  mesh.vertices[b, 2] - mesh.vertices[a, 2])
    qx, qy, qz = (mesh.vertices[c, 0] - mesh.vertices[a, 0], mesh.vertices[c, 1] - mesh.vertices[a, 1],
                  mesh.vertices[c, 2] - mesh.vertices[a, 2])
    fx, fy, fz = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
    size = np.sqrt(fx * fx + fy * fy + fz * fz)
    side = -1.0 if fx * d[0] + fy * d[1] + fz * d[2] > 0.0 else 1.0  # the facet's normal, towards the ray
    if size > 0.0:
        fx, fy, fz = side * fx / size, side * fy / size, side * fz / size
    nx = w * mesh.normals[a, 0] + u * mesh.normals[b, 0] + v * mesh.normals[c, 0]
    ny = w * mesh.normals[a, 1] + u * mesh.normals[b, 1] + v * mesh.normals[c, 1]
    nz = w * mesh.normals[a, 2] + u * mesh.normals[b, 2] + v * mesh.normals[c, 2]
    size = np.sqrt(nx * nx + ny * ny + nz * nz)
    if size > 0.0:
        flip = -1.0 / size if nx * fx + ny * fy + nz * fz < 0.0 else 1.0 / size
        nx, ny, nz = flip * nx, flip * ny, flip * nz
    else:
        nx, ny, nz = fx, fy, fz
    # Lifted to the surface that the vertices and their normals describe, so that facets cast no shadow on each other.
    sx = sy = sz = 0.0
    for corner, weight in ((a, w), (b, u), (c, v)):
        mx, my, mz = mesh.normals[corner, 0], mesh.normals[corner, 1], mesh.normals[corner, 2]
        if mx * fx + my * fy + mz * fz < 0.0:
            mx, my, mz = -mx, -my, -mz
        below = min((x - mesh.vertices[corner, 0]) * mx + (y - mesh.vertices[corner, 1]) * my
                    + (z - mesh.vertices[corner, 2]) * mz, 0.0) * weight
        sx, sy, sz = sx - below * mx, sy - below * my, sz - below * mz
    facing = -(nx * d[0] + ny * d[1] + nz * d[2])
    if facing < MIN_FACING:  # turned back to the ray
        turn = facing - MIN_FACING
        nx, ny, nz = nx + turn * d[0], ny + turn * d[1], nz + turn * d[2]
        size = np.sqrt(nx * nx + ny * ny + nz * nz)
        nx, ny, nz = nx / size, ny / size, nz / size
        facing = MIN_FACING
    out.ray[k], out.distance[k], out.radius[k] = n, t, radius + spread * t
    out.point[k, 0], out.point[k, 1], out.point[k, 2] = x, y, z
    out.normal[k, 0], out.normal[k, 1], out.normal[k, 2] = nx, ny, nz
    out.start[k, 0], out.start[k, 1], out.start[k, 2] = x + sx + lift * fx, y + sy + lift * fy, z + sz + lift * fz
    out.sky[k] = w * mesh.sky[a] + u * mesh.sky[b] + v * mesh.sky[c]
    out.material[k] = mesh.material[f]
    out.uv[k, 0] = w * mesh.uv[a, 0] + u * mesh.uv[b, 0] + v * mesh.uv[c, 0]
    out.uv[k, 1] = w * mesh.uv[a, 1] + u * mesh.uv[b, 1] + v * mesh.uv[c, 1]
    out.foot[k, 0], out.foot[k, 1] = x + max(z, 0.0) * nx, y + max(z, 0.0) * ny
    slope = abs(fx * d[0] + fy * d[1] + fz * d[2])
    out.covered[k] = 2.0 * out.radius[k] * mesh.per_mm[f] / np.sqrt(max(slope, 0.01))
    out.to_sun[k] = nx * sun[0] + ny * sun[1] + nz * sun[2]


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def contact_shadows(points: Array, first: NDArray[np.int64], which: NDArray[np.int64], bins_from: float, bin_size: float,
                    frames: Array, shapes: NDArray[np.int64], shares: Array, sky: Array) -> None:
    """Multiply shares of the sky by those of the grids that lie over each ground point, bilinear between their nodes.

    Parameters
    ----------
    points : (n, ≥ 2), mm.
    first, which, bins_from, frames, shapes, shares : as in `raytrace.scene.lit_world.Shadows`.
    bin_size : of the bins, mm.
    sky : (n,), what is multiplied.
    """
    bins = first.size - 1
    for n in range(points.shape[0]):
        b = int(np.floor((points[n, 0] - bins_from) / bin_size))
        if b < 0 or b >= bins:
            continue
        for m in range(first[b], first[b + 1]):
            k = which[m]
            dx, dy = points[n, 0] - frames[k, 0], points[n, 1] - frames[k, 1]
            i, j = dx * frames[k, 2] + dy * frames[k, 3], dx * frames[k, 4] + dy * frames[k, 5]
            if i < 0.0 or j < 0.0 or i > shapes[k, 1] - 1 or j > shapes[k, 2] - 1:
                continue
            r, c = min(int(i), shapes[k, 1] - 2), min(int(j), shapes[k, 2] - 2)
            a, e = i - r, j - c
            at = shapes[k, 0] + r * shapes[k, 2] + c
            sky[n] *= (1.0 - a) * ((1.0 - e) * shares[at] + e * shares[at + 1]) \
                + a * ((1.0 - e) * shares[at + shapes[k, 2]] + e * shares[at + shapes[k, 2] + 1])


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _sky_at(table: NDArray[np.float32], x: float, y: float, z: float, c: int) -> float:
    """Radiance of the sky in a direction, of any length, with z ≥ 0."""
    side = table.shape[0] - 1
    whole = abs(x) + abs(y) + z
    i, j = 0.5 * side * (1.0 + (x + y) / whole), 0.5 * side * (1.0 + (x - y) / whole)
    r, k = min(max(int(i), 0), side - 1), min(max(int(j), 0), side - 1)
    a, b = i - r, j - k
    return (1.0 - a) * ((1.0 - b) * table[r, k, c] + b * table[r, k + 1, c]) \
        + a * ((1.0 - b) * table[r + 1, k, c] + b * table[r + 1, k + 1, c])


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def surroundings(directions: Array, spread: Array, light: Light, disc: bool, out: Array) -> None:
    """Write the radiance of sky and ground without a thing before them.

    Parameters
    ----------
    directions : (n, 3), unit.
    spread : (n,), radians, that the sun's edge is softened by.
    light : of sky and sun.
    disc : whether with the sun's.
    out : (n, 3), radiance, kcd/m² a channel.
    """
    for n in range(directions.shape[0]):
        x, y, z = directions[n, 0], directions[n, 1], directions[n, 2]
        for c in range(3):
            out[n, c] = light.below[c] if z < 0.0 else _sky_at(light.table, x, y, z, c)
        if disc and z >= 0.0:
            cosine = x * light.sun[0] + y * light.sun[1] + z * light.sun[2]
            if cosine > 0.99:
                # |d × s| and not arccos, which loses half the digits here.
                cx = y * light.sun[2] - z * light.sun[1]
                cy = z * light.sun[0] - x * light.sun[2]
                cz = x * light.sun[1] - y * light.sun[0]
                away = np.sqrt(cx * cx + cy * cy + cz * cz)
                soft = min(max(spread[n], LIMB * SUN_RADIUS), SUN_RADIUS)
                share = min(max(0.5 - 0.5 * (away - SUN_RADIUS) / soft, 0.0), 1.0)
                solid = np.pi * (SUN_RADIUS**2 + soft**2 / 3.0)  # ∫ share dω: the disc gives what it gives at any softness
                for c in range(3):
                    out[n, c] += share * light.sun_irradiance[c] / solid


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def mirrored(found: SurfaceInteraction, directions: Array, out: Array) -> None:
    """Write the mirror directions d − 2·(n·d)·n at points, unit.

    Parameters
    ----------
    found : the points.
    directions : (m, 3), of the rays that met them.
    out : (n, 3), what is written.
    """
    for k in range(found.ray.size):
        d = directions[found.ray[k]]
        x, y, z = found.normal[k, 0], found.normal[k, 1], found.normal[k, 2]
        twice = 2.0 * (x * d[0] + y * d[1] + z * d[2])
        x, y, z = d[0] - twice * x, d[1] - twice * y, d[2] - twice * z
        size = 1.0 / np.sqrt(x * x + y * y + z * z)
        out[k, 0], out[k, 1], out[k, 2] = x * size, y * size, z * size


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _irradiance(h: Array, x: float, y: float, z: float, c: int) -> float:
    return max(h[0, c] + h[1, c] * y + h[2, c] * z + h[3, c] * x + h[4, c] * x * y + h[5, c] * y * z
               + h[6, c] * (3.0 * z * z - 1.0) + h[7, c] * x * z + h[8, c] * (x * x - y * y), 0.0)


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def shade(found: SurfaceInteraction, directions: Array, diffuse: Array, lit: NDArray[np.bool_], on_ground: int, specular: Array,
          roughness: Array, bounce: Array, image: Array, traced: NDArray[np.bool_], light: Light, least_slopes: float,
          out: Array) -> None:
    """Write the radiance that each point sends along its ray, seen through the air, at the ray's row.

    Parameters
    ----------
    found : n points.
    directions : (m, 3), unit, of the rays.
    diffuse : (n, 3), reflectance of the points.
    lit : (n,), whether the sun's disc is seen.
    on_ground : how many of the points, the first ones, are on the ground.
    specular, roughness : (k, 3) and (k,), of materials.
    bounce, image, traced : (n − on_ground, 3), (…, 3) and (…), of the points on bodies: the mirror direction, the radiance
        there, and whether that is of what stands there (then nothing else hides it).
    light : of sky and sun.
    least_slopes : GGX width of the sun's highlight, at least.
    out : (m, 3), radiance, kcd/m² a channel.

    References
    ----------
    docs/derivations/daylight.md; Lagarde and de Rousiers 2014; Walter et al. 2007.
    """
    for k in range(found.ray.size):
        nx, ny, nz = found.normal[k, 0], found.normal[k, 1], found.normal[k, 2]
        sun = max(found.to_sun[k], 0.0) if lit[k] else 0.0
        d = directions[found.ray[k]]
        body = k >= on_ground
        m = found.material[k]
        facing = grazing = slopes = hidden = highlight = 0.0
        b = k - on_ground
        if body:
            facing = max(-(nx * d[0] + ny * d[1] + nz * d[2]), MIN_FACING)
            grazing = (1.0 - facing) ** 5 * (1.0 - roughness[m])  # what a rough surface reflects at grazing angles, it hides
            slopes = roughness[m] ** 2
            hidden = 1.0
            if not traced[b]:  # Lagarde and de Rousiers 2014
                hidden = min(max((facing + found.sky[k]) ** np.exp2(-16.0 * roughness[m] - 1.0) - 1.0 + found.sky[k], 0.0), 1.0)
            if sun > 0.0:
                highlight = _highlight(nx, ny, nz, d, light.sun, sun, facing, max(slopes, least_slopes))
        before = min(max(found.to_sun[k] / SUNNY, 0.0), 1.0)
        reach = np.sqrt(directions[found.ray[k], 0] ** 2 + directions[found.ray[k], 1] ** 2)
        for c in range(3):
            rho = diffuse[k, c]
            share = found.sky[k] / (1.0 - rho * (1.0 - found.sky[k]))
            # The ground before a body's foot gets less of the sky, and on the side away from the sun none of it.
            hidden_below = (1.0 - found.ground[k]) * (light.below[c] - before * light.below_sun[c])
            indirect = _irradiance(light.harmonics, nx, ny, nz, c) - hidden_below * 0.5 * np.pi * (1.0 - nz)
            value = rho / np.pi * (max(indirect, 0.0) * share + light.sun_irradiance[c] * sun)
            if body:
                f0 = specular[m, c]
                fresnel = f0 + (min(FULL_FROM * f0, 1.0) - f0) * grazing
                blurred = _irradiance(light.harmonics, bounce[b, 0], bounce[b, 1], bounce[b, 2], c) / np.pi
                seen = image[b, c] + slopes * (blurred - image[b, c])
                value = (1.0 - fresnel) * value + fresnel * hidden * seen
                if highlight > 0.0:
                    value += highlight * _schlick(f0, nx, ny, nz, d, light.sun) * light.sun_irradiance[c]
            if light.extinction[c] > 0.0:
                clear = np.exp(-light.extinction[c] * found.distance[k])
                air = _sky_at(light.table, d[0], d[1], 0.0, c) if reach > 0.0 else value
                value = air + clear * (value - air)
            out[found.ray[k], c] = value


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _schlick(f0: float, nx: float, ny: float, nz: float, d: Array, sun: Array) -> float:
    """F at the half vector between ray and sun."""
    hx, hy, hz = sun[0] - d[0], sun[1] - d[1], sun[2] - d[2]
    size = np.sqrt(hx * hx + hy * hy + hz * hz)
    return f0 + (min(FULL_FROM * f0, 1.0) - f0) * (1.0 - (hx * sun[0] + hy * sun[1] + hz * sun[2]) / size) ** 5


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _highlight(nx: float, ny: float, nz: float, d: Array, sun: Array, to_sun: float, facing: float, slopes: float) -> float:
    """D·G/(4·n·v), Walter et al. 2007, of GGX with Smith's shadowing: times F and the sun's irradiance it is radiance."""
    hx, hy, hz = sun[0] - d[0], sun[1] - d[1], sun[2] - d[2]
    size = np.sqrt(hx * hx + hy * hy + hz * hz)
    cosine = (nx * hx + ny * hy + nz * hz) / size
    square = slopes * slopes
    density = square / (np.pi * (cosine * cosine * (square - 1.0) + 1.0) ** 2)
    shadowing = 2.0 * to_sun * facing / (facing * np.sqrt(square + (1.0 - square) * to_sun * to_sun)
                                         + to_sun * np.sqrt(square + (1.0 - square) * facing * facing))
    return density * shadowing / (4.0 * facing)
