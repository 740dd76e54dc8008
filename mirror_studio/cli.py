"""The command line: `mirror-cad …` runs a command, and says how it ended."""

from __future__ import annotations

import os
import sys

from cyclopts import CycloptsError

from mirror_studio import interrupt
from mirror_studio.commands import bench, made_mirrors, many_designs, on_the_road, one_mirror, studio  # noqa: F401 (listed)
from mirror_studio.commands.app import BAD_INPUT, DONE, FAILED, MISSED, app

__all__ = ["BAD_INPUT", "DONE", "FAILED", "MISSED", "app", "main", "run"]


def main(arguments: list[str] | None = None) -> None:
    """Run a command and leave with its exit code: 0 done, 2 bad input, 3 done but something asked for is missed, 1 else."""
    for name in ("stdout", "stderr"):  # closed by whoever started us: then nobody reads
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115
    # Sums that threads share are rounded by how many there are, and figures are to be the same on every machine. Matrices are
    # of a few hundred rows at most: a second thread brings little, and the tracer wants the cores.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # A polite end is an interrupt: what was begun is cleared away.
    interrupt.install()
    code = run(arguments)
    if interrupt.asked():
        interrupt.leave(code)
    sys.exit(code)


def run(arguments: list[str] | None = None) -> int:
    """Run a command; returns its exit code."""
    try:
        result = app(arguments, print_error=False, exit_on_error=False)
        return result if isinstance(result, int) else DONE
    except CycloptsError as error:
        print(f"mirror-cad: {' '.join(str(error).split())}\n`mirror-cad --help` lists commands and options.", file=sys.stderr)
        return BAD_INPUT
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except KeyboardInterrupt:
        return _stopped()
    except ImportError as error:
        if interrupt.asked():
            return _stopped()
        print(f"mirror-cad: a part of the installation cannot be loaded: {error}", file=sys.stderr)
        return FAILED
    except Exception as error:
        return _stopped() if interrupt.asked() else _report(error)


def _stopped() -> int:
    print(interrupt.STOPPED, file=sys.stderr)
    return FAILED


def _report(error: Exception) -> int:
    """Say what went wrong without a traceback; MIRROR_CAD_TRACEBACK=1 shows it."""
    from mirror_cad.errors import MirrorError, WriteError

    if os.environ.get("MIRROR_CAD_TRACEBACK"):
        raise error
    if not isinstance(error, MirrorError):
        print(f"mirror-cad: internal error: {type(error).__name__}: {error}\nPlease report it; MIRROR_CAD_TRACEBACK=1 shows "
              "where it arose.", file=sys.stderr)
        return FAILED
    for line in str(error).splitlines():
        print(f"mirror-cad: {line}", file=sys.stderr)
    return FAILED if isinstance(error, WriteError) else BAD_INPUT
