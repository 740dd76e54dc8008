"""Judge hard cases in processes that a case can take down without harm."""

from __future__ import annotations

import faulthandler
import math
import multiprocessing
import re
import signal
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from queue import SimpleQueue

from mirror_cad.errors import MirrorError
from mirror_studio.bench.hard.case import Case, Figure, Refusal
from mirror_studio.bench.table import Row
from mirror_studio.progress import Progress

LONGEST_WAIT = 12.0  # times the limit by the clock, for a case that waits without working
AT_ONCE = 2
WARM_UP_S = 600.0  # for the kernel's import and numba's first compilation
PACKAGES = ("mirror_cad", "raytrace", "mirror_studio")
STACK = "stack.txt"

GOOD = WITHIN, REFUSED = "within", "refused"
BAD = OUTSIDE, NOT_A_NUMBER, NOT_REFUSED, WRONGLY_REFUSED, CAUSE_NOT_NAMED, INTERNAL, CRASHED, HANGS = (
    "outside", "NaN", "not refused", "wrongly refused", "cause not named", "internal error", "crashed", "hangs")


def judge(case: Case) -> Row:
    """Run a case here and now; the table's row with its verdict."""
    row = _empty_row(case)
    start = time.process_time()
    try:
        with tempfile.TemporaryDirectory(prefix="hard-case-") as folder:
            figures = case.run(Path(folder))
    except MirrorError as error:
        message = " ".join(str(error).replace(f"{folder}/", "").split())
        row |= {"verdict": _refusal_verdict(case.refusal, error), "remark": message}
    except Exception as error:  # whatever it is, it is this case's result and not the table's end
        row |= {"verdict": INTERNAL, "remark": f"{type(error).__name__}: {error}"}
    else:
        row |= _figures_row(case, figures)
    return row | {"seconds": time.process_time() - start}


def _refusal_verdict(expected: Refusal | None, error: MirrorError) -> str:
    if expected is None or not isinstance(error, expected.kind):
        return WRONGLY_REFUSED
    return REFUSED if all(word in str(error) for word in expected.words) else CAUSE_NOT_NAMED


def _figures_row(case: Case, figures: Sequence[Figure]) -> Row:
    if case.refusal is not None:
        return {"verdict": NOT_REFUSED, "remark": f"expected a {case.refusal.kind.__name__}: {case.hard}"}
    lost = [figure for figure in figures if not math.isfinite(figure.value)]
    worst = max(figures, key=lambda figure: figure.share)
    verdict = NOT_A_NUMBER if lost else WITHIN if worst.share <= 1.0 else OUTSIDE
    shown = lost[0] if lost else figures[0] if verdict == WITHIN else worst
    return {"what": shown.what, "figure": None if lost else shown.value, "tolerance": shown.tolerance, "unit": shown.unit,
            "verdict": verdict, "remark": shown.reason}


@dataclass(frozen=True, slots=True)
class Work:
    """What workers are to do: module functions, so that another process can import them, and a case's limit.

    find : the case of a name.   warm_up : what no case's time is to hold.
    """

    find: Callable[[str], Case]
    warm_up: Callable[[], None]
    limit_s: float


def _serve(connection: Connection, work: Work, folder: str) -> None:
    """A worker's whole life: warm up, say so, then a row for each name that comes. A timer's signal ends it at the limit.

    folder : for the cases' files, and for the call stack if the process dies; the caller clears it away.
    """
    tempfile.tempdir = folder
    stack = open(Path(folder) / STACK, "w")  # noqa: SIM115  (as long as the process lives)
    faulthandler.enable(stack)
    faulthandler.register(signal.SIGPROF, stack, all_threads=False, chain=True)
    work.warm_up()
    connection.send(None)
    while True:
        try:
            name = connection.recv()
        except EOFError:
            return
        signal.setitimer(signal.ITIMER_PROF, work.limit_s)  # its signal ends the process even inside the kernel's code
        row = judge(work.find(name))
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        connection.send(row)


class _Worker:
    """A process that judges one case after the other, and is replaced where one kills it or takes too long."""

    def __init__(self, work: Work) -> None:
        self._work = work
        self._folder = tempfile.TemporaryDirectory(prefix="hard-cases-")
        self._start()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, self._work, self._folder.name), daemon=True)
        self._process.start()
        theirs.close()
        if not self._connection.poll(WARM_UP_S):
            self.stop()
            raise RuntimeError(f"a worker did not start within {WARM_UP_S:g} s")
        self._connection.recv()

    def judge(self, name: str) -> Row:
        """The case's row; of a case that ended the process, what ended it."""
        self._connection.send(name)
        try:
            if self._connection.poll(LONGEST_WAIT * self._work.limit_s):
                row: Row = self._connection.recv()
                return row
        except (EOFError, ConnectionResetError):
            self._process.join()
        code = self._process.exitcode
        self._end()
        stack = (Path(self._folder.name) / STACK).read_text()
        self._start()
        where = re.search(rf"/((?:{'|'.join(PACKAGES)})/.*)\", line (\d+) in (\w+)", stack)
        within = f", in {where[1]}:{where[2]} ({where[3]})" if where else ""
        if code is None or code == -signal.SIGPROF:
            limit = self._work.limit_s
            end = {"verdict": HANGS, "remark": f"over {limit:g} s{within}", "seconds": limit}
        else:
            by = signal.Signals(-code).name if code < 0 else f"exit code {code}"
            end = {"verdict": CRASHED, "remark": by + within, "seconds": None}
        return _empty_row(self._work.find(name)) | end

    def _end(self) -> None:
        self._process.kill()
        self._process.join()
        self._connection.close()

    def stop(self) -> None:
        self._end()
        self._folder.cleanup()


def _empty_row(case: Case) -> Row:
    return {"case": case.name, "hard": case.hard, "what": None, "figure": None, "tolerance": None, "unit": None}


def run_cases(names: Sequence[str], work: Work, progress: Progress | None = None) -> list[Row]:
    """The cases' rows in their order, AT_ONCE at a time, each in a process that it can take down without harm."""
    workers: SimpleQueue[_Worker] = SimpleQueue()

    def judged(name: str) -> Row:
        worker = workers.get()
        try:
            row = worker.judge(name)
        finally:
            workers.put(worker)
        if progress is not None:
            progress.step(f"hard cases: {name}: {row['verdict']}")
        return row

    with ThreadPoolExecutor(AT_ONCE) as pool:
        try:
            for worker in pool.map(_Worker, [work] * min(AT_ONCE, len(names))):
                workers.put(worker)
            return list(pool.map(judged, names))
        finally:
            while not workers.empty():
                workers.get().stop()
