"""What a box hides of segments that move, against every one of many segments asked by itself."""

from __future__ import annotations

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from raytrace.viewing.vehicle import HostVehicle
from raytrace.visibility.intervals import IntervalSet, intersection, union
from raytrace.visibility.occlusion import grazing_functions, unhidden

Array = NDArray[np.float64]

DENSE = 20_001  # segments asked one by one
BOX = HostVehicle(870.0, -200.0, 3900.0, 2450.0)


def inside_somewhere(box: HostVehicle, starts: Array, ends: Array) -> NDArray[np.bool_]:
    """Whether segments pass the inside of a box: clipped plane by plane (Liang and Barsky 1984)."""
    low, high = np.zeros(len(starts)), np.ones(len(starts))
    kept = np.ones(len(starts), dtype=np.bool_)
    for axis, (least, most) in enumerate(((box.front_mm, box.rear_mm), (-box.half_width_mm, box.half_width_mm),
                                          (0.0, box.height_mm))):
        for sign, plane in ((1.0, most), (-1.0, -least)):
            way, room = sign * (ends - starts)[:, axis], plane - sign * starts[:, axis]
            kept &= (way != 0.0) | (room > 0.0)
            with np.errstate(divide="ignore", invalid="ignore"):
                share = room / way
            high = np.where(way > 0.0, np.minimum(high, share), high)
            low = np.where(way < 0.0, np.maximum(low, share), low)
    return kept & (low < high)


def moving(seed: int) -> tuple[HostVehicle, Array]:
    """A box of any size, and what segments that start beside, before, in or behind it are made of."""
    rng = np.random.default_rng(seed)
    box = HostVehicle(rng.uniform(200.0, 2000.0), rng.uniform(-3000.0, 0.0), rng.uniform(500.0, 9000.0),
                     rng.uniform(300.0, 4000.0))
    reach = np.array([4000.0, 3000.0, 2500.0])
    start = rng.uniform(-1.0, 1.0, (4, 3)) * reach * [[1.0], [0.2], [0.05], [0.02]]
    end = rng.uniform(-1.0, 1.0, (4, 3)) * [20_000.0, 9000.0, 3000.0] * np.array([[1.0], [1.0], [0.3], [0.1]])
    start[0, 2], end[0, 2] = abs(start[0, 2]), abs(end[0, 2])
    if seed % 2:  # on the ground, along a line
        end[:, 2] = 0.0
        end[2:] = 0.0
    return box, np.stack([start, end])


def segments(of: Array, t: Array) -> tuple[Array, Array]:
    """Starts and ends at parameters (n,): polynomials."""
    powers = np.stack([t**k for k in range(4)], axis=1)
    return powers @ of[0], powers @ of[1]


@settings(max_examples=300)
@example(1)
@given(st.integers(0, 2**32 - 1))
def test_no_interval_is_missed_and_every_end_grazes(seed: int) -> None:
    box, of = moving(seed)
    at = np.linspace(-1.0, 1.0, 17)
    found = unhidden(box, np.zeros(17, dtype=np.intp), at, segments(of, at),
                     lambda cell, share: segments(of, at[cell] + share * (at[cell + 1] - at[cell])))
    dense = np.linspace(-1.0, 1.0, DENSE)
    hidden = inside_somewhere(box, *segments(of, dense))
    seen = found.mask(1, dense)[0]
    nearest = np.abs(dense[:, None] - np.concatenate([found.low, found.high, [9.0]])).min(axis=1)
    odd = (seen == hidden) & (nearest > 1e-9)
    assert not odd.any(), f"wrong at {dense[odd][:3]}"
    ends = np.concatenate([found.low, found.high])
    values = np.abs(grazing_functions(box, *segments(of, ends))).min(axis=0)
    assert (values[np.abs(ends) < 1.0] < 1e-5).all()


def test_the_very_ends_of_a_row_count_and_rows_do_not_meet() -> None:
    """What passes the box only just after its first sample and only just before its last one."""
    at = np.array([0.0, 1.0, 2.0, 0.0, 1.0, 2.0])
    row = np.array([3, 3, 3, 7, 7, 7])

    def rays(cell: NDArray[np.intp], share: Array) -> tuple[Array, Array]:
        return parallel(row[cell], at[cell] + share)

    def parallel(rows: NDArray[np.intp], t: Array) -> tuple[Array, Array]:
        """Level rays along X, which on row 3 come out of the flank's plane at t = 1e-7, and on row 7 into it at 2 − 1e-7."""
        y = np.where(rows == 3, -870.0 - (t - 1e-7), -870.0 + (t - 2.0 + 1e-7))
        start = np.stack([np.full(len(t), -600.0), y, np.full(len(t), 1700.0)], axis=1)
        return start, start + [50_000.0, 0.0, 0.0]

    found = unhidden(BOX, row, at, parallel(row, at), rays)
    assert found.row.tolist() == [3, 7]
    assert np.abs(found.low - [1e-7, 0.0]).max() < 1e-10
    assert np.abs(found.high - [2.0, 2.0 - 1e-7]).max() < 1e-10


def test_a_dip_between_two_samples_is_found() -> None:
    """Segments whose line comes to 0.1 mm inside the flank half way between two samples, over 2 % of the way between them."""
    at = np.linspace(0.0, 4.0, 5)

    def move(t: Array) -> tuple[Array, Array]:
        start = np.stack([np.full(len(t), -600.0), -870.0 - 1000.0 * ((t - 2.5)**2 - 1e-4), np.full(len(t), 1700.0)], axis=1)
        return start, start + [50_000.0, 0.0, 0.0]

    found = unhidden(BOX, np.zeros(5, dtype=np.intp), at, move(at), lambda cell, share: move(at[cell] + share))
    assert np.abs(found.high - [2.49, 4.0]).max() < 1e-9
    assert np.abs(found.low - [0.0, 2.51]).max() < 1e-9


def test_union_and_intersection_of_what_touches() -> None:
    row = np.zeros(2, dtype=np.intp)
    a = IntervalSet(row, np.array([0.0, 2.0]), np.array([1.0, 3.0]))
    b = IntervalSet(row, np.array([1.0, 2.5]), np.array([2.0, 4.0]))
    assert union(a, b).of(0).tolist() == [[0.0, 4.0]]
    assert intersection(a, b).of(0).tolist() == [[2.5, 3.0]]
