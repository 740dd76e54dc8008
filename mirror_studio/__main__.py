"""`python -m mirror_studio` is `mirror-cad`."""

import atexit
import gc
import os
import sys

from mirror_studio import interrupt

# The collector's usual 700 objects between two of its rounds have it go hundreds of times through what the libraries bring,
# a tenth of a short command's time. Arrays go without it, by their counts.
OBJECTS_BETWEEN_COLLECTIONS = 100_000


def main() -> None:
    """Run a command; an interrupt ends it in the same way from here on, before anything is imported."""
    interrupt.install()
    gc.set_threshold(OBJECTS_BETWEEN_COLLECTIONS)
    from mirror_studio.cli import main as run

    try:
        run()
    except SystemExit as ended:
        if ended.code is not None and not isinstance(ended.code, int):
            raise
        _leave(ended.code or 0)


def _leave(code: int) -> None:
    """End with an exit code, everything closed and written, and leave the memory to the system.

    To take apart a process with the CAD kernel in it object by object takes a second of processor time.
    """
    atexit._run_exitfuncs()
    try:
        sys.stdout.flush()
    except BrokenPipeError:  # nobody reads any more
        pass
    except OSError as error:
        print(f"mirror-cad: the standard output cannot be written: {error}", file=sys.stderr)
        code = code or interrupt.FAILED
    os._exit(code)  # the standard error has no buffer


if __name__ == "__main__":
    main()
