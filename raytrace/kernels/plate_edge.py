"""Where on straight ways over the picture plane a plate of glass ceases to reflect, by where its rays pass the two sheets."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.blocks import clamp
from raytrace.kernels.compiled import compiled, inner
from raytrace.kernels.glass import PASSED, Sheets
from raytrace.kernels.outcomes import HIT, LOST
from raytrace.kernels.trimming import in_interior, inside

OPEN, FOUND, NO_END, UNKNOWN = range(4)  # of a way: still looked at; its end is found; none is between its two; a ray was LOST
UNSEEN, SEEN, ASK = range(3)  # of a ray; ASK: it was LOST, or has not been traced
# Of a bracket's square: by how much the end may lie beside where straight lines between the rays of the bracket have it. These
# are bent by some hundredths of the first one, a way of one to three mm.
BENT = 0.02
# Of what the rays through a cell's corners span on a sheet, and of the cosine to z: by how much those between may go beyond.
WIDER, TURNED = 0.1, 0.05
SLACK = 1e-9  # of an edge and of a way, by which they may miss each other by rounding


class Plate(NamedTuple):
    """A plate of glass, of whose rays it is told where they pass its sheets.

    Attributes
    ----------
    sheets, untrimmed : with the trimming and without.
    reach : (2, 4), u and v from and to which the trimming of front and back goes.
    bounds : (2, 3), mm, of a box that the trimmed front lies in.
    """

    sheets: Sheets
    untrimmed: Sheets
    reach: NDArray[np.float64]
    bounds: NDArray[np.float64]


@inner()
def _first_crossing(strips, u_0, v_0, u_1, v_1):
    """The share of a straight way in (u, v) at which it first crosses an edge of polygons; inf where it crosses none."""
    first, edges, last_strip = strips.first, strips.edges, strips.first.size - 2
    best = np.inf
    if not abs(u_0) + abs(v_0) + abs(u_1) + abs(v_1) < np.inf:
        return best
    top = float(last_strip)
    start = int(clamp((min(v_0, v_1) - strips.low) * strips.inverse_height, 0.0, top))
    stop = int(clamp((max(v_0, v_1) - strips.low) * strips.inverse_height, 0.0, top))
    du, dv = u_1 - u_0, v_1 - v_0
    wide = SLACK * (abs(du) + abs(dv))
    u_low, u_high, v_low, v_high = min(u_0, u_1) - wide, max(u_0, u_1) + wide, min(v_0, v_1) - wide, max(v_0, v_1) + wide
    for k in range(first[start], first[stop + 1]):
        if (edges[k, 0] < u_low and edges[k, 2] < u_low) or (edges[k, 0] > u_high and edges[k, 2] > u_high) \
                or (edges[k, 1] < v_low and edges[k, 3] < v_low) or (edges[k, 1] > v_high and edges[k, 3] > v_high):
            continue
        along_u, along_v = edges[k, 2] - edges[k, 0], edges[k, 3] - edges[k, 1]
        from_u, from_v = edges[k, 0] - u_0, edges[k, 1] - v_0
        turn = du * along_v - dv * along_u
        share, on_edge = (from_u * along_v - from_v * along_u) / turn, (from_u * dv - from_v * du) / turn
        if -SLACK <= on_edge <= 1.0 + SLACK and -SLACK <= share < best:
            best = share
    return best


@inner()
def _verdict(sheets, k, rays, status, directions, passed, rim):
    """Whether ray k is reflected inside all trimming, and not by a rim, from where it passes the untrimmed sheets."""
    u, v, x, y, out_u, out_v = (passed[PASSED * k], passed[PASSED * k + 1], passed[PASSED * k + 2], passed[PASSED * k + 3],
                                passed[PASSED * k + 4], passed[PASSED * k + 5])
    for known, strips, a, b in ((u == u, sheets.front_strips, u, v), (x == x, sheets.back_strips, x, y),
                                (out_u == out_u, sheets.front_strips, out_u, out_v)):
        if known and not inside(strips, a, b):
            return UNSEEN
    if status[k] != HIT:
        return ASK if status[k] == LOST else UNSEEN
    dx, dy, dz = rays[3 * k], rays[3 * k + 1], rays[3 * k + 2]
    length = np.sqrt(dx * dx + dy * dy + dz * dz)
    nx, ny, nz = directions[3 * k] - dx / length, directions[3 * k + 1] - dy / length, directions[3 * k + 2] - dz / length
    return SEEN if nz > rim * np.sqrt(nx * nx + ny * ny + nz * nz) else UNSEEN


@inner()
def _expected(sheets, a, b):
    """The share of the way between the rays of a bracket, a and b (6,), at which the first of the three trimmings ends it."""
    share = _first_crossing(sheets.front_strips, a[0], a[1], b[0], b[1])
    share = min(share, _first_crossing(sheets.back_strips, a[2], a[3], b[2], b[3]))
    return min(share, _first_crossing(sheets.front_strips, a[4], a[5], b[4], b[5]))


@inner()
def _aim(eye, start, end, share, k, rays):
    for c in range(2):
        rays[3 * k + c] = start[c] + share * (end[c] - start[c]) - eye[c]
    rays[3 * k + 2] = -eye[2]


@compiled(nogil=True, _nrt=False)
def begin(eye, starts, ends, going, shares, rays):
    """Aim rays at both ends of ways (n, 2) each, in the order of `going` (n,): shares (2n,) of the way, rays (6n,)."""
    for i in range(going.shape[0]):
        n = going[i]
        shares[2 * i], shares[2 * i + 1] = 0.0, 1.0
        _aim(eye, starts[n], ends[n], 0.0, 2 * i, rays)
        _aim(eye, starts[n], ends[n], 1.0, 2 * i + 1, rays)


@compiled(nogil=True, _nrt=False)
def narrow(plate, eye, starts, ends, going, count, shares, rays, status, directions, passed, rim, settled, brackets, places,
           outcome):
    """Narrow the brackets of ways by two rays on each, and aim the next two.

    Parameters
    ----------
    plate : the plate.   eye : (3,), mm.
    starts, ends : (n, 2), mm, of the picture plane.
    going, count : which ways the rays are about; those that go on afterwards.
    shares, rays : (2n,), of the way, rising for each, and (6n,), towards them. Both are written anew.
    status, directions, passed : what became of the rays on the untrimmed sheets.
    rim : cosine of the turn against z from which a face is a rim.   settled : width, of the way, that ends the search.
    brackets : (n, 2), shares of the way, seen and not.   places : (n, 2, 6), where the rays there pass the sheets.
    outcome : (n,), of each way; OPEN for those that are new.

    Returns
    -------
    How many go on.
    """
    sheets, kept = plate.sheets, 0
    for i in range(count):
        n = going[i]
        one = _verdict(sheets, 2 * i, rays, status, directions, passed, rim)
        two = _verdict(sheets, 2 * i + 1, rays, status, directions, passed, rim)
        if one == ASK or two == ASK:
            outcome[n] = UNKNOWN
            continue
        fresh = not brackets[n, 1] > 0.0
        before = 4.0 if fresh else brackets[n, 1] - brackets[n, 0]
        if fresh and (one != SEEN or two == SEEN):
            outcome[n] = NO_END
            continue
        last = -1 if one != SEEN else 1 if two == SEEN else 0  # which of the two is the last that is seen
        if last >= 0:
            brackets[n, 0] = shares[2 * i + last]
            for c in range(PASSED):
                places[n, 0, c] = passed[PASSED * (2 * i + last) + c]
        if last < 1:
            brackets[n, 1] = shares[2 * i + last + 1]
            for c in range(PASSED):
                places[n, 1, c] = passed[PASSED * (2 * i + last + 1) + c]
        low, high = brackets[n]
        width = high - low
        if width <= settled:
            outcome[n] = FOUND
            continue
        expected = _expected(sheets, places[n, 0], places[n, 1]) if width <= 0.5 * before else np.inf
        if expected < np.inf:
            margin = max(BENT * width * width, 0.4 * settled)
            one_at = clamp(low + expected * width - margin, low, high)
            two_at = clamp(low + expected * width + margin, low, high)
        else:  # the last guess missed, or there is none
            one_at, two_at = low + width / 3.0, high - width / 3.0
        going[kept], shares[2 * kept], shares[2 * kept + 1] = n, one_at, two_at
        _aim(eye, starts[n], ends[n], one_at, 2 * kept, rays)
        _aim(eye, starts[n], ends[n], two_at, 2 * kept + 1, rays)
        kept += 1
    return kept


@inner()
def _sides(bounds, eye, rays, k):
    """The sides of a box (2, 3) on which ray k passes it while it is between its lowest and its highest z: 1 to 8, added."""
    found = 0
    for c in range(2):
        per_height = rays[3 * k + c] / rays[3 * k + 2]
        one, two = eye[c] + (bounds[0, 2] - eye[2]) * per_height, eye[c] + (bounds[1, 2] - eye[2]) * per_height
        found += (1 << 2 * c) * int(max(one, two) < bounds[0, c]) + (2 << 2 * c) * int(min(one, two) > bounds[1, c])
    return found


@compiled(nogil=True, _nrt=False)
def verdicts(plate, eye, rays, status, directions, passed, rim, found):
    """Whether rays (3n,) are reflected inside all trimming, into found (n,): SEEN, UNSEEN, or ASK for those that were LOST.

    What passes beside the front is not LOST.
    """
    for k in range(found.shape[0]):
        found[k] = _verdict(plate.sheets, k, rays, status, directions, passed, rim)
        if found[k] == ASK and _sides(plate.bounds, eye, rays, k) > 0:
            found[k] = UNSEEN


@inner()
def _box(passed, corners, c):
    """From where to where the rays of a cell pass a sheet, and a little wider: coordinates c and c + 1."""
    u_low = v_low = np.inf
    u_high = v_high = -np.inf
    for k in corners:
        u, v = passed[PASSED * k + c], passed[PASSED * k + c + 1]
        u_low, u_high, v_low, v_high = min(u_low, u), max(u_high, u), min(v_low, v), max(v_high, v)
        if not abs(u) + abs(v) < np.inf:
            return np.nan, np.nan, np.nan, np.nan
    wider_u, wider_v = WIDER * (u_high - u_low), WIDER * (v_high - v_low)
    return u_low - wider_u, u_high + wider_u, v_low - wider_v, v_high + wider_v


@compiled(nogil=True, _nrt=False)
def fill_cells(plate, eye, rays, status, directions, passed, rim, step, found):
    """Tell what all points of a grid's cells show, by the rays through their corners.

    Parameters
    ----------
    plate : the plate.   eye : (3,), mm.
    rays, status, directions, passed : of every `step`-th point of the grid both ways, on the untrimmed sheets.
    rim, step : as in `narrow`, and how many points of the grid a cell takes each way.
    found : (m, n) of the grid: SEEN and UNSEEN are written where a cell is sure to be; ASK stays for the others.
    """
    sheets, reach = plate.sheets, plate.reach
    columns, rows = (found.shape[0] - 1) // step, (found.shape[1] - 1) // step
    for i in range(columns):
        for j in range(rows):
            k = i * (rows + 1) + j
            corners = (k, k + 1, k + rows + 1, k + rows + 2)
            every, sides = True, 15
            for corner in corners:
                sides &= _sides(plate.bounds, eye, rays, corner)
                if _verdict(sheets, corner, rays, status, directions, passed, rim + TURNED) != SEEN:
                    every = False
            none = sides > 0
            for stage in range(3):
                u_low, u_high, v_low, v_high = _box(passed, corners, 2 * stage)
                strips, of = (sheets.back_strips, 1) if stage == 1 else (sheets.front_strips, 0)
                every = every and in_interior(strips.interior, strips.low, strips.inverse_height, u_low, u_high, v_low, v_high)
                if u_high < reach[of, 0] or u_low > reach[of, 1] or v_high < reach[of, 2] or v_low > reach[of, 3]:
                    none = True
            if every or none:
                for a in range(i * step, (i + 1) * step + 1):
                    for b in range(j * step, (j + 1) * step + 1):
                        found[a, b] = SEEN if every else UNSEEN
