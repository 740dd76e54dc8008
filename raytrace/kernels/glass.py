"""Rays into a plate of glass, to its reflecting back and out again, sixteen at a time, in float64."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.block_heights import forget_cells, heights
from raytrace.kernels.blocks import (
    BACK_X,
    BACK_Y,
    BACK_Z,
    BLOCK,
    DOWN,
    DX,
    DY,
    DZ,
    ENTRY,
    GAP,
    LAST,
    LIMIT_P,
    MISS,
    NX,
    NY,
    NZ,
    OX,
    OY,
    OZ,
    RX,
    RY,
    RZ,
    K,
    P,
    Results,
    T,
    U,
    V,
    X,
    Y,
    Z,
    box,
    fix_degenerate_rays,
    go_along,
    load,
    store,
    store_all,
    work,
)
from raytrace.kernels.compiled import compiled, inner
from raytrace.kernels.height_field import HeightField, comes_down, shallow_rays
from raytrace.kernels.height_field import met as met_from_above
from raytrace.kernels.newton import begin_newton, newton_step
from raytrace.kernels.outcomes import ACCEPTED, BEHIND, BLOCKED, HIT, LOST, MAX_STEPS, NEAREST_MM, OUTSIDE
from raytrace.kernels.parametric import Patches, across, centred, from_plane, kept_near, met, refined, residuals, stepped
from raytrace.kernels.trimming import Strips, in_interior, inside
from raytrace.kernels.vectors import RAYS, count_of, eight, put, root, size, where

Array = NDArray[np.float64]

PARTS = 3  # coordinates of a front: a rational one goes stage by stage
# Where a ray passes the sheets, in rows that only a fourth coordinate would need: (u, v) where it comes in, (x, y) where it is
# turned, (u, v) where it leaves.
IN_U, IN_V, TURN_X, TURN_Y, OUT_U, OUT_V = (first + BLOCK * k for first in (P, K) for k in range(3 * PARTS, 3 * PARTS + 3))
PASSED = 6  # numbers of a ray
NOWHERE: Array = np.empty(0)  # for rays of which that is not asked


class Sheets(NamedTuple):
    """A plate's two sheets.

    Attributes
    ----------
    front, front_strips : what lets light in and out again, and its trimming.
    sign, one_sided : S_u × S_v of the front times sign is outward; whether rays from the other side are BEHIND.
    back, back_strips : what reflects.
    refraction : index of the glass against air.
    """

    front: Patches
    front_strips: Strips
    sign: float
    one_sided: bool
    back: HeightField
    back_strips: Strips
    refraction: float


@inner(fastmath={"contract"})
def _refracted(eta, w):
    """d' = η·d + (η·c − √(1 − η² + η²c²))·n into the rows R, n against the ray.

    The squared root into MISS; returns how many rays have none: they are totally reflected.
    """
    total = 0
    for m in range(0, BLOCK, RAYS):
        dx, dy, dz = eight(w, DX + m), eight(w, DY + m), eight(w, DZ + m)
        nx, ny, nz = eight(w, NX + m), eight(w, NY + m), eight(w, NZ + m)
        c = -eta * (dx * nx + dy * ny + dz * nz)
        squared = (1.0 - eta) * (1.0 + eta) + c * c
        turned = c - root(squared)
        put(w, RX + m, eta * dx + turned * nx)
        put(w, RY + m, eta * dy + turned * ny)
        put(w, RZ + m, eta * dz + turned * nz)
        put(w, MISS + m, squared)
        total += count_of(squared < 0.0)
    return total


@inner()
def _doubled(state, w):
    """Give lanes whose ray has ended what a lane has whose ray goes on, so that all can be taken on; False where none does."""
    alive = -1
    for m in range(BLOCK):
        if state[m] == HIT:
            alive = m
    if alive < 0:
        return False
    for m in range(BLOCK):
        if state[m] != HIT:
            for row in (OX, OY, OZ, DX, DY, DZ, X, Y, Z, NX, NY, NZ, RX, RY, RZ, T, U, V, DOWN, GAP):
                w[row + m] = w[row + alive]
            for row in range(3 * PARTS):
                w[P + row * BLOCK + m] = w[P + row * BLOCK + alive]
    return True


@inner()
def _entered(sheets, state, w):
    """What became of rays at the front, as `raytrace.kernels.parametric.hits` says."""
    ends_u, ends_v = sheets.front.cells.ends_u, sheets.front.cells.ends_v
    for m in range(BLOCK):
        if state[m] != HIT:
            continue
        u, v = w[U + m], w[V + m]
        if not (w[LAST + m] <= ACCEPTED * w[LIMIT_P + m] and abs(w[NX + m]) <= 1.0):
            state[m] = LOST
        elif w[T + m] > NEAREST_MM and inside(sheets.front_strips, u, v):
            if sheets.one_sided and w[MISS + m] >= 0.0:
                state[m] = BEHIND
        elif not ends_u[0] <= u <= ends_u[-2] or not ends_v[0] <= v <= ends_v[-2]:
            state[m] = LOST
        else:
            state[m] = OUTSIDE


@compiled(fastmath={"contract"}, inline="always")
def _to_back(powers, back, w):
    """Newton to the sheet from T along the rays: `raytrace.kernels.height_field.met` there.

    Returns how many meet it.
    """
    begin_newton(w)
    forget_cells(w)
    was_on_sheet = False
    go_along(w)
    for _ in range(MAX_STEPS):
        on_sheet = heights(powers, back.cells, w)
        moving = newton_step(back, was_on_sheet and on_sheet, w)
        go_along(w)
        if moving == 0:
            break
        was_on_sheet = on_sheet
    good = met_from_above(0.0, w)
    if shallow_rays(back.steepest, w) > 0:  # which may have met it before
        good = 0
        for m in range(0, BLOCK, RAYS):
            found = comes_down(back.steepest, m, w) & (eight(w, MISS + m) <= 0.0)
            put(w, MISS + m, where(found, 0.0, 1.0))
            good += count_of(found)
    return good


@inner()
def _turned(sheets, state, w):
    """What became of rays at the back: those that meet no reflecting part of it stay inside."""
    ends_x, ends_y = sheets.back.cells.ends_u, sheets.back.cells.ends_v
    for m in range(BLOCK):
        if state[m] != HIT:
            continue
        if w[MISS + m] != 0.0 or not (ends_x[0] <= w[X + m] <= ends_x[-2] and ends_y[0] <= w[Y + m] <= ends_y[-2]):
            state[m] = LOST
        elif not inside(sheets.back_strips, w[X + m], w[Y + m]):
            state[m] = BLOCKED


@inner()
def _left(sheets, state, w):
    """What became of rays at the front from inside: LAST is inf where they do not keep to its cone."""
    ends_u, ends_v = sheets.front.cells.ends_u, sheets.front.cells.ends_v
    for m in range(BLOCK):
        if state[m] != HIT:
            continue
        u, v = w[U + m], w[V + m]
        if not (w[LAST + m] <= ACCEPTED * w[LIMIT_P + m] and abs(w[NX + m]) <= 1.0 and w[T + m] > 0.0) \
                or not (ends_u[0] <= u <= ends_u[-2] and ends_v[0] <= v <= ends_v[-2]):
            state[m] = LOST
        elif not inside(sheets.front_strips, u, v) or w[MISS + m] < 0.0:
            state[m] = BLOCKED


@inner(fastmath={"contract"})
def _kept_to_cone(sheet, state, w):
    """Give rays outside the front's cone, which may meet it more than once, a direction inside it; how many there are."""
    ended = 0
    for m in range(BLOCK):
        down = sheet[0] * w[DX + m] + sheet[1] * w[DY + m] + sheet[2] * w[DZ + m]
        if not abs(down) > sheet[3]:
            state[m] = LOST if state[m] == HIT else state[m]
            w[DX + m], w[DY + m], w[DZ + m] = -sheet[0], -sheet[1], -sheet[2]
            ended += 1
    return ended


@inner()
def _begin_anew(w):
    """Rays that begin at (X, Y, Z) in the directions R."""
    for m in range(0, BLOCK, RAYS):
        put(w, DX + m, eight(w, RX + m))
        put(w, DY + m, eight(w, RY + m))
        put(w, DZ + m, eight(w, RZ + m))
        put(w, OX + m, eight(w, X + m))
        put(w, OY + m, eight(w, Y + m))
        put(w, OZ + m, eight(w, Z + m))


@inner(fastmath={"contract"})
def _go_down(index, w):
    """Refract rays into the glass, and take them as far down as the back was along the normal for the lane's last ray."""
    _refracted(1.0 / index, w)
    _begin_anew(w)
    for m in range(0, BLOCK, RAYS):
        dx, dy, dz = eight(w, DX + m), eight(w, DY + m), eight(w, DZ + m)
        down = -(dx * eight(w, NX + m) + dy * eight(w, NY + m) + dz * eight(w, NZ + m))
        put(w, DOWN + m, down)
        put(w, T + m, eight(w, GAP + m) / down)


@inner(fastmath={"contract"})
def _go_up(w):
    """Take rays up from the back, and note how far it was along the normal, and its own normals."""
    for m in range(0, BLOCK, RAYS):
        put(w, GAP + m, eight(w, T + m) * eight(w, DOWN + m))
        put(w, BACK_X + m, eight(w, NX + m))
        put(w, BACK_Y + m, eight(w, NY + m))
        put(w, BACK_Z + m, eight(w, NZ + m))
    _begin_anew(w)


@inner(fastmath={"contract"})
def _arrived(sheet, w):
    """How many rays from inside met the front; LAST becomes inf for those outside its cone."""
    good = 0
    for m in range(0, BLOCK, RAYS):
        down = size(sheet[0] * eight(w, DX + m) + sheet[1] * eight(w, DY + m) + sheet[2] * eight(w, DZ + m))
        last = where(down > sheet[3], eight(w, LAST + m), np.inf)
        put(w, LAST + m, last)
        good += count_of((last <= ACCEPTED * eight(w, LIMIT_P + m)) & (eight(w, T + m) > 0.0) & (size(eight(w, NX + m)) <= 1.0))
    return good


@inner()
def _passed(state, first, second, first_to, second_to, w):
    """Note where rays that go on pass a sheet."""
    for m in range(BLOCK):
        if state[m] == HIT:
            w[first_to + m], w[second_to + m] = w[first + m], w[second + m]


@inner()
def _came_in(state, w):
    """Note where rays come in, also a little beyond the front's domain, where its polynomials go on: they are LOST there."""
    for m in range(BLOCK):
        if state[m] == HIT and w[LAST + m] <= ACCEPTED * w[LIMIT_P + m] and w[T + m] > NEAREST_MM:
            w[IN_U + m], w[IN_V + m] = w[U + m], w[V + m]


@inner()
def _store_passed(w, start, count, passed):
    for m in range(count):
        n = PASSED * (start + m)
        passed[n], passed[n + 1], passed[n + 2], passed[n + 3] = w[IN_U + m], w[IN_V + m], w[TURN_X + m], w[TURN_Y + m]
        passed[n + 4], passed[n + 5] = w[OUT_U + m], w[OUT_V + m]


@cache
def _kernel(powers):
    """The kernel for sheets of `powers` = degree + 1 both ways."""
    @compiled(nogil=True, fastmath={"contract"}, _nrt=False)
    def hits(w, state, sheets, origins, directions, results, passed):
        front, back = sheets.front, sheets.back
        n_rays = directions.size // 3
        for m in range(BLOCK):
            w[GAP + m] = 0.0
        for start in range(0, n_rays, BLOCK):
            count = min(BLOCK, n_rays - start)
            degenerate = load(origins, directions, start, count, w)
            for m in range(BLOCK):
                state[m] = HIT
            if degenerate > 0:
                fix_degenerate_rays(directions, start, count, w, state)
            if passed.size > 0:
                for m in range(BLOCK):
                    w[IN_U + m] = w[IN_V + m] = w[TURN_X + m] = w[TURN_Y + m] = w[OUT_U + m] = w[OUT_V + m] = np.nan
            whole = degenerate == 0 and count == BLOCK
            for leaving in range(2):  # in one loop, so that the front's polynomials are compiled once
                centred(front, w)
                if leaving:
                    across(w)
                    residuals(w)  # on the tangent plane where the ray came in, whose point and slopes are still there
                    stepped(front, w)
                else:
                    if from_plane(front, w) > 0:
                        _kept_to_cone(front.sheet, state, w)
                        whole = False
                    across(w)
                    kept_near(front, w)
                refined(powers, PARTS, front, w)
                good = met(front, sheets.sign, sheets.one_sided and not leaving, w)
                u_low, u_high, v_low, v_high = box(w, U, V)
                within = in_interior(sheets.front_strips.interior, sheets.front_strips.low, sheets.front_strips.inverse_height,
                                     u_low, u_high, v_low, v_high)
                if leaving:
                    arrived, total = _arrived(front.sheet, w), _refracted(sheets.refraction, w)
                    whole = whole and within and arrived == BLOCK and total == 0
                    if not whole:
                        _left(sheets, state, w)
                    if passed.size > 0:
                        _passed(state, U, V, OUT_U, OUT_V, w)
                    for m in range(0, BLOCK, RAYS):
                        put(w, NX + m, eight(w, BACK_X + m))
                        put(w, NY + m, eight(w, BACK_Y + m))
                        put(w, NZ + m, eight(w, BACK_Z + m))
                    break
                for m in range(0, BLOCK, RAYS):
                    put(w, ENTRY + m, eight(w, T + m))
                if passed.size > 0:
                    _came_in(state, w)
                if not (whole and good == BLOCK and within):
                    whole = False
                    _entered(sheets, state, w)
                    if not _doubled(state, w):
                        break
                _go_down(sheets.refraction, w)
                good = _to_back(powers, back, w)
                x_low, x_high, y_low, y_high = box(w, X, Y)
                if good < BLOCK or not in_interior(sheets.back_strips.interior, sheets.back_strips.low,
                                                   sheets.back_strips.inverse_height, x_low, x_high, y_low, y_high):
                    whole = False
                    _turned(sheets, state, w)
                    if passed.size > 0:
                        _passed(state, X, Y, TURN_X, TURN_Y, w)
                    if not _doubled(state, w):
                        break
                elif passed.size > 0:
                    _passed(state, X, Y, TURN_X, TURN_Y, w)
                _go_up(w)
            for m in range(0, BLOCK, RAYS):
                put(w, T + m, eight(w, ENTRY + m))
            if whole:
                store_all(w, start, results)
            else:
                store(w, state, start, count, results)
            if passed.size > 0:
                _store_passed(w, start, count, passed)

    return hits


def hits(sheets: Sheets, origins: Array, directions: Array, results: Results, passed: Array = NOWHERE) -> None:
    """Trace rays into a plate by its front, to its reflecting back, and out by the front.

    Newton on each sheet: on the front as `raytrace.kernels.parametric` has it, on the back from as far along the normal as it
    was for the ray before, and on the front again from its tangent plane where the ray came in. Of the ray that leaves,
    results are those of `raytrace.surfaces.plate.Plate.first_hits`.

    A ray is LOST where one of the three places is not known to be the only one: `Plate` takes it face by face.

    Parameters
    ----------
    sheets : of the plate.
    origins, directions : (3,) or (3n,), mm, and (3n,), of any length, flat.
    results : of the n rays.
    passed : (6n,), for (u, v) where each ray comes in, (x, y) where the back turns it, and (u, v) where it leaves; NaN from
        where on its way ends. Empty where that is not asked.
    """
    rows, state, _ = work()
    _kernel(sheets.front.cells.powers)(rows, state, sheets, origins, directions, results, passed)
