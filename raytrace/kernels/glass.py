"""Rays into a plate of glass, to its reflecting back and out again, sixteen at a time, in float64."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
    LIMIT,
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
    ZX,
    ZY,
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
    load,
    reflect,
    store,
    store_all,
    work,
)
from raytrace.kernels.compiled import compiled, inner
from raytrace.kernels.height_field import SHALLOWEST, HeightField, heights
from raytrace.kernels.newton import begin_newton, newton_step
from raytrace.kernels.outcomes import ACCEPTED, BEHIND, BLOCKED, HIT, LOST, MAX_STEPS, NEAREST_MM, OUTSIDE
from raytrace.kernels.parametric import Patches, across, centred, from_plane, kept_near, met, refined, residuals, stepped
from raytrace.kernels.trimming import Strips, in_interior, inside

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
    for m in range(BLOCK):
        along = w[DX + m] * w[NX + m] + w[DY + m] * w[NY + m] + w[DZ + m] * w[NZ + m]
        c = -eta * along
        squared = (1.0 - eta) * (1.0 + eta) + c * c
        turned = c - np.sqrt(squared)
        w[RX + m] = eta * w[DX + m] + turned * w[NX + m]
        w[RY + m] = eta * w[DY + m] + turned * w[NY + m]
        w[RZ + m] = eta * w[DZ + m] + turned * w[NZ + m]
        w[MISS + m] = squared
        total += int(squared < 0.0)
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
    """Newton to the sheet from T along the rays: points, slopes and upward normals there, and MISS 0 where it is met.

    Returns how many meet it.
    """
    begin_newton(w)
    was_on_sheet = False
    for _ in range(MAX_STEPS):
        for m in range(BLOCK):
            w[X + m], w[Y + m] = w[OX + m] + w[T + m] * w[DX + m], w[OY + m] + w[T + m] * w[DY + m]
        on_sheet = heights(powers, back.cells, w)
        if newton_step(back, was_on_sheet and on_sheet, w) == 0:
            break
        was_on_sheet = on_sheet
    good = 0
    for m in range(BLOCK):
        w[X + m], w[Y + m] = w[OX + m] + w[T + m] * w[DX + m], w[OY + m] + w[T + m] * w[DY + m]
        w[Z + m] = w[OZ + m] + w[T + m] * w[DZ + m]
        steep = 1.0 + w[ZX + m] * w[ZX + m] + w[ZY + m] * w[ZY + m]
        upright = 1.0 / np.sqrt(steep)
        w[NX + m], w[NY + m], w[NZ + m] = -w[ZX + m] * upright, -w[ZY + m] * upright, upright
        facing = w[DX + m] * w[NX + m] + w[DY + m] * w[NY + m] + w[DZ + m] * w[NZ + m]
        flat = w[DX + m] * w[DX + m] + w[DY + m] * w[DY + m]
        # Down steeply enough to meet the sheet only once, from the front on.
        once = (w[DZ + m] <= -SHALLOWEST) & (w[DZ + m] * w[DZ + m] > back.steepest * flat)
        found = once & (w[MISS + m] <= ACCEPTED * ACCEPTED * w[LIMIT + m] * steep) & (w[T + m] > 0.0) & (facing < 0.0)
        w[MISS + m] = 0.0 if found else 1.0
        good += int(found)
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


@inner(fastmath={"contract"})
def _go_down(index, w):
    """Refract rays into the glass, and take them as far down as the back was along the normal for the lane's last ray."""
    _refracted(1.0 / index, w)
    for m in range(BLOCK):
        w[DX + m], w[DY + m], w[DZ + m] = w[RX + m], w[RY + m], w[RZ + m]
        w[OX + m], w[OY + m], w[OZ + m] = w[X + m], w[Y + m], w[Z + m]
        w[DOWN + m] = -(w[DX + m] * w[NX + m] + w[DY + m] * w[NY + m] + w[DZ + m] * w[NZ + m])
        w[T + m] = w[GAP + m] / w[DOWN + m]


@inner(fastmath={"contract"})
def _go_up(w):
    """Take rays up from the back, and note how far it was along the normal, and its own normals."""
    for m in range(BLOCK):
        w[GAP + m] = w[T + m] * w[DOWN + m]
        w[BACK_X + m], w[BACK_Y + m], w[BACK_Z + m] = w[NX + m], w[NY + m], w[NZ + m]
        w[DX + m], w[DY + m], w[DZ + m] = w[RX + m], w[RY + m], w[RZ + m]
        w[OX + m], w[OY + m], w[OZ + m] = w[X + m], w[Y + m], w[Z + m]


@inner(fastmath={"contract"})
def _arrived(sheet, w):
    """How many rays from inside met the front; LAST becomes inf for those outside its cone."""
    good = 0
    for m in range(BLOCK):
        down = abs(sheet[0] * w[DX + m] + sheet[1] * w[DY + m] + sheet[2] * w[DZ + m])
        w[LAST + m] = w[LAST + m] if down > sheet[3] else np.inf
        good += int((w[LAST + m] <= ACCEPTED * w[LIMIT_P + m]) & (w[T + m] > 0.0) & (abs(w[NX + m]) <= 1.0))
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
                    for m in range(BLOCK):
                        w[NX + m], w[NY + m], w[NZ + m] = w[BACK_X + m], w[BACK_Y + m], w[BACK_Z + m]
                    break
                for m in range(BLOCK):
                    w[ENTRY + m] = w[T + m]
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
                reflect(w)
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
            for m in range(BLOCK):
                w[T + m] = w[ENTRY + m]
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
