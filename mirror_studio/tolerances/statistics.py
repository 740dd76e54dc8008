"""Rows of mirrors as they come out in, the interval of each measure, the share inside limits and Sobol indices out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirror_studio.explore.evaluate import Row
from mirror_studio.tolerances.file import Tolerances

Array = NDArray[np.float64]
Interval = tuple[float, float]

RESAMPLES = 199  # of the bootstrap: the ends of its intervals are known to a tenth of their width
LEVEL = 0.95  # of what is said about how sure a share or an index is
SEED = 1
CONSTANT = 1e-9  # of a measure's size: what varies by less varies by rounding


@dataclass(frozen=True, slots=True)
class Index:
    """What one tolerance does to a measure.

    Attributes
    ----------
    first, total : float
        Sobol's indices: of the variance, what it brings by itself, and what is gone without it, interactions included.
    first_interval, total_interval : tuple
        95 % of each, by bootstrap over samples.
    sigma_without : float
        Of the measure, if this tolerance were nought.
    """

    first: float
    total: float
    first_interval: Interval
    total_interval: Interval
    sigma_without: float


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """One measure over all mirrors.

    Attributes
    ----------
    designed : float or None
        Of the mirror without departures.
    values : ndarray
        Of the mirrors that have it.
    missing : int
        How many have not.
    interval : tuple or None
        Between which the middle part of them lies.
    limit : tuple or None
        The least and the most that is asked.
    inside : float or None
        The share of mirrors within, of all.
    inside_interval : tuple or None
        95 % of that share.
    indices : mapping
        By tolerance; empty where the measure does not vary, or too few mirrors have it.
    indices_from : int
        Samples that the indices are from.
    """

    designed: float | None
    values: Array
    missing: int
    interval: Interval | None
    limit: Interval | None
    inside: float | None
    inside_interval: Interval | None
    indices: Mapping[str, Index]
    indices_from: int

    @property
    def mean(self) -> float | None:
        """Of the mirrors that have it."""
        return float(self.values.mean()) if self.values.size else None

    @property
    def sigma(self) -> float | None:
        """Standard deviation of the mirrors that have it."""
        return float(self.values.std(ddof=1)) if self.values.size > 1 else None


@dataclass(frozen=True, slots=True, eq=False)
class Outcomes:
    """All measures over all mirrors.

    Attributes
    ----------
    by_measure : mapping
        In the order that they were asked for in.
    failed : int
        Mirrors that could not be made or measured.
    inside : float or None
        The share of mirrors that meet all limits; None where there is none.
    inside_interval : tuple or None
        95 % of it.
    """

    by_measure: Mapping[str, Outcome]
    failed: int
    inside: float | None
    inside_interval: Interval | None


def outcomes(study: Tolerances, designed: Row, rows: Sequence[Row]) -> Outcomes:
    """Sum up all mirrors of a study, in the order of `Tolerances.mirrors`.

    Parameters
    ----------
    study : Tolerances
        What they are of.
    designed : Row
        The mirror without departures.
    rows : sequence of Row
        samples × (tolerances + 2).
    """
    count, names = study.file.samples, [factor.name for factor in study.factors]
    share = study.file.interval_percent / 100.0
    found, all_inside = {}, np.ones((len(names) + 2, count), dtype=bool)
    for k, measure in enumerate(study.measures):
        values = np.array([np.nan if row.figures[k] is None else row.figures[k] for row in rows]).reshape(-1, count)
        limit = study.limits.get(measure)
        inside = None
        if limit is not None:
            inside = (values >= limit[0]) & (values <= limit[1])  # what a mirror does not show is not inside
            all_inside &= inside
        known = values[np.isfinite(values)]
        indices, used = sobol_indices(values, names)
        found[measure] = Outcome(
            designed.figures[k], known, int(values.size - known.size),
            _middle(known, share) if known.size else None, limit,
            None if inside is None else float(inside.mean()), None if inside is None else _interval_of_share(inside),
            indices, used)
    return Outcomes(found, sum(row.status != "ok" for row in rows), float(all_inside.mean()) if study.limits else None,
                    _interval_of_share(all_inside) if study.limits else None)


def sobol_indices(values: Array, names: Sequence[str]) -> tuple[dict[str, Index], int]:
    """Estimate the indices of each tolerance, and their intervals.

    Parameters
    ----------
    values : ndarray
        (d + 2, n) of A, of B, and of A with the columns of each of d tolerances from B; NaN where a mirror has none.
    names : sequence of str
        Of the tolerances.

    Returns
    -------
    dict, int
        The indices, and how many samples they are from: all or, where some are not complete, as large a power of two as
        there is of those that are. Empty and 0 where that is too few, or nothing varies.
    """
    from scipy import stats

    complete = np.flatnonzero(np.isfinite(values).all(axis=0))
    if len(complete) < 2:
        return {}, 0
    count = 1 << (len(complete).bit_length() - 1)
    of = values[:, complete[:count]]
    sigma = float(of[:2].std())
    if sigma <= CONSTANT * max(float(np.abs(of).max()), CONSTANT):
        return {}, 0
    bringing = [k for k in range(len(names)) if (of[k + 2] != of[0]).any()]  # the others have no part in this measure
    indices = dict.fromkeys(names, Index(0.0, 0.0, (0.0, 0.0), (0.0, 0.0), sigma))
    if len(bringing) == 1:  # all of it is this one's, which needs no estimate
        return indices | {names[bringing[0]]: Index(1.0, 1.0, (1.0, 1.0), (1.0, 1.0), 0.0)}, count
    found = stats.sobol_indices(func={"f_A": of[:1], "f_B": of[1:2], "f_AB": of[2:][bringing][:, None, :]}, n=count,
                                rng=np.random.default_rng(SEED))
    sure = found.bootstrap(confidence_level=LEVEL, n_resamples=RESAMPLES)
    for k, factor in enumerate(bringing):
        first, total, *ends = (float(np.atleast_1d(each)[k]) for each in (
            found.first_order, found.total_order, *sure.first_order.confidence_interval,
            *sure.total_order.confidence_interval))
        indices[names[factor]] = Index(first, total, (ends[0], ends[1]), (ends[2], ends[3]),
                                       sigma * float(np.sqrt(1.0 - min(max(first, 0.0), 1.0))))
    return indices, count


def _middle(values: Array, share: float) -> Interval:
    low, high = np.quantile(values, [0.5 - 0.5 * share, 0.5 + 0.5 * share])
    return float(low), float(high)


def _interval_of_share(inside: NDArray[np.bool_]) -> Interval:
    """95 % of a share, as so many mirrors tell it that have nothing in common: two a sample (Wilson)."""
    from scipy import stats

    count = 2 * inside.shape[1]
    sure = stats.binomtest(round(count * float(inside.mean())), count).proportion_ci(LEVEL, "wilson")
    return float(sure.low), float(sure.high)
