"""Hard cases: each comes out within its tolerance or is refused with its cause named; and the runner survives the rest."""

from __future__ import annotations

import faulthandler
import math
import os
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from mirror_cad.errors import ProfileError, SpecError
from mirror_studio.bench.hard.case import Case, Figure, Refusal
from mirror_studio.bench.hard.cases import case_named, cases
from mirror_studio.bench.hard.runner import (
    CAUSE_NOT_NAMED,
    CRASHED,
    GOOD,
    HANGS,
    INTERNAL,
    NOT_A_NUMBER,
    NOT_REFUSED,
    OUTSIDE,
    REFUSED,
    WITHIN,
    WRONGLY_REFUSED,
    Work,
    judge,
    run_cases,
)
from mirror_studio.bench.hard_cases import table_of

# Of the cases that are built, those of every run; the others are `long`. Refusals take no time and are all of every run.
EVERY_RUN = {
    "plane", "nearly plane", "curvature 1e-300", "concave", "sign-changing law", "cylinder, upright straight",
    "cylinder, straight across", "umbilic line inside", "jump, not announced", "kink, not announced", "kink upright",
    "level at the edge", "table of two rows", "20 mm wide, radii scaled", "origin 20 m away", "corners of 0.1 mm", "star",
    "plate of 0.05 mm", "plate of 60 mm", "degree 9, one span", "Euler, h = 10 mm", "faithful: sphere", "faithful: plane",
}
LONGEST_S = 120.0  # a case in this process that takes longer is stuck: all of them together take half of it


@pytest.fixture(autouse=True)
def _no_endless_test() -> Iterator[None]:
    """A case that is stuck in the kernel's code heeds no signal: the tests end with the place it is stuck at."""
    faulthandler.dump_traceback_later(LONGEST_S, exit=True, file=sys.__stderr__)
    yield
    faulthandler.cancel_dump_traceback_later()


def marked(name: str) -> object:
    quick = name in EVERY_RUN or case_named(name).refusal is not None
    return name if quick else pytest.param(name, marks=pytest.mark.long)


@pytest.mark.parametrize("name", [marked(name) for name in cases()])
def test_hard_case_is_within_its_tolerance_or_refused(name: str) -> None:
    row = judge(case_named(name))
    assert row["verdict"] in GOOD, row


def test_cases_have_names_and_reasons_of_their_own() -> None:
    assert set(cases()) >= EVERY_RUN
    assert len(cases()) > 100
    assert all(case.hard for case in cases().values())


# --- the verdicts ----------------------------------------------------------------------------------------------------


def figure(value: float) -> Figure:
    return Figure("length", value, 2.0, "mm", "half of four")


def returns(*figures: Figure, refusal: Refusal | None = None) -> Case:
    def run(folder: Path) -> Sequence[Figure]:
        return figures

    return Case("made up", "nothing", run, refusal)


def raises(error: Exception, refusal: Refusal | None = None) -> Case:
    def run(folder: Path) -> Sequence[Figure]:
        raise error

    return Case("made up", "nothing", run, refusal)


EXPECTED = Refusal(SpecError, ("radius", "7 mm"))


@pytest.mark.parametrize(("case", "verdict"), [
    (returns(figure(-2.0), figure(1.0)), WITHIN),
    (returns(figure(1.0), figure(-2.1)), OUTSIDE),
    (returns(figure(1.0), figure(math.nan)), NOT_A_NUMBER),
    (returns(figure(math.inf)), NOT_A_NUMBER),
    (returns(Figure("open edges", 1.0, 0.0, "", "a solid is closed")), OUTSIDE),
    (returns(figure(1.0), refusal=EXPECTED), NOT_REFUSED),
    (raises(SpecError("the radius is 7 mm"), EXPECTED), REFUSED),
    (raises(SpecError("the radius is wrong"), EXPECTED), CAUSE_NOT_NAMED),
    (raises(ProfileError("the radius is 7 mm"), EXPECTED), WRONGLY_REFUSED),
    (raises(SpecError("the radius is 7 mm")), WRONGLY_REFUSED),
    (raises(RuntimeError("Standard_Failure"), EXPECTED), INTERNAL),
], ids=lambda value: value if isinstance(value, str) else "")
def test_verdicts(case: Case, verdict: str) -> None:
    assert judge(case)["verdict"] == verdict


def test_a_row_shows_what_the_case_is_about_or_what_fails() -> None:
    assert judge(returns(figure(0.1), figure(1.9)))["figure"] == 0.1
    assert judge(returns(figure(0.1), figure(2.5), figure(3.0)))["figure"] == 3.0


def test_the_table_counts_its_verdicts() -> None:
    rows = [judge(case) for case in (returns(figure(1.0)), returns(figure(1.0)), returns(figure(9.0)), raises(SpecError("no")))]
    table = table_of(rows)
    assert table.rows == tuple(rows)
    assert {column.key for column in table.columns} == set(rows[0])
    assert "2 within their tolerances, 0 refused" in table.text
    assert "1 outside, 1 wrongly refused" in table.text
    assert "none otherwise" in table_of(rows[:1]).text


# --- the runner ------------------------------------------------------------------------------------------------------


def broken(name: str) -> Case:
    """Cases that a worker does not survive, found by name in the worker as the real ones are."""

    def dies(folder: Path) -> Sequence[Figure]:
        os.kill(os.getpid(), signal.SIGSEGV)
        return ()

    def spins(folder: Path) -> Sequence[Figure]:
        while True:
            pass

    def sleeps(folder: Path) -> Sequence[Figure]:
        time.sleep(3600.0)
        return ()

    work = {"dies": dies, "spins": spins, "sleeps": sleeps, "works": lambda folder: (figure(1.0),)}
    return Case(name, "nothing", work[name.split()[0]])


def nothing() -> None:
    """A warm-up for cases that need no kernel."""


def test_a_case_that_crashes_or_hangs_becomes_a_row() -> None:
    names = ["works", "dies", "spins", "sleeps", "works again"]
    rows = run_cases(names, Work(broken, nothing, limit_s=0.25))
    assert [row["case"] for row in rows] == names
    assert [row["verdict"] for row in rows] == [WITHIN, CRASHED, HANGS, HANGS, WITHIN]
    assert rows[1]["remark"].startswith("SIGSEGV, in mirror_studio/bench/hard/runner.py:")
    assert rows[2]["remark"].startswith("over 0.25 s, in ")
