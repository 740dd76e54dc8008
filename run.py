#!/usr/bin/env python3
"""Set up mirror-cad in .venv and run it. Needs Python 3.11, 3.12, 3.13 or 3.14 with pip, and nothing else.

    python3.11 run.py paper           reproduce the paper into exports/paper
    python3.11 run.py COMMAND …       any other mirror-cad command (--help lists them)
    python3.11 run.py test [--long]   lint, types, import rules and tests
    python3.11 run.py docs            the documents as a site, into exports/docs

The first run installs the locked versions, checked by their hashes; later ones only see that nothing has changed.
"""

from __future__ import annotations

import ctypes.util
import hashlib
import os
import shutil
import subprocess
import sys
import venv
from pathlib import Path

HOME = Path(__file__).resolve().parent
VENV = HOME / ".venv"
PYTHON = VENV / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
# Two, as the machines of CI have cores; files go to the workers whole, but for those that share a server (tests/conftest.py).
WORKERS = ("-n", "2", "--dist", "loadgroup")
PYTHONS = ((3, 11), (3, 12), (3, 13), (3, 14))
# What the CAD kernel and numba load from the system, and the Debian package that has it.
SYSTEM_LIBRARIES = {"GL": "libgl1", "X11": "libx11-6", "expat": "libexpat1", "gomp": "libgomp1"}


def main(arguments: list[str]) -> int:
    if sys.version_info[:2] not in PYTHONS:
        known = [f"{major}.{minor}" for major, minor in PYTHONS]
        here = next((f"python{name}" for name in reversed(known) if shutil.which(f"python{name}")), f"python{known[0]}")
        return _stop(f"Python {', '.join(known[:-1])} or {known[-1]} is needed (this is {sys.version.split()[0]}): "
                     f"run  {here} run.py …")
    if not arguments:
        print(__doc__)
        return 2
    here = {"test": _test, "docs": _docs}.get(arguments[0])
    if not _set_up("requirements-test.lock" if here else "requirements.lock"):
        return 1
    return here(arguments[1:]) if here else _call([PYTHON, "-m", "mirror_studio", *arguments])


def _set_up(lock: str) -> bool:
    """Install a lock file into .venv unless its stamp says that it, pyproject.toml and Python are as they were."""
    stamp = VENV / f"{lock}.stamp"
    python = "{}.{}".format(*sys.version_info)
    wanted = python + hashlib.sha256(b"".join((HOME / name).read_bytes() for name in (lock, "pyproject.toml"))).hexdigest()
    if stamp.is_file() and stamp.read_text() == wanted:
        return True
    missing = [package for name, package in SYSTEM_LIBRARIES.items() if ctypes.util.find_library(name) is None]
    if sys.platform == "linux" and missing:
        _stop("the system lacks libraries that the CAD kernel loads; on Debian or Ubuntu:  apt-get install "
              + " ".join(missing))
        return False
    stamps = list(VENV.glob("*.stamp"))  # an environment without one was not made here, and is not taken away
    of_another = any(not each.read_text().startswith(python) for each in stamps)
    if not PYTHON.exists() or of_another:
        print(f"Making the environment in .venv, for Python {python}", file=sys.stderr)
        venv.create(VENV, with_pip=True, clear=of_another)
    print(f"Installing the versions of {lock} (some 3 GB; about two minutes, once)", file=sys.stderr, flush=True)
    pip = [PYTHON, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    # Without dependencies: the lock has them all but one, which build123d asks for and the lock leaves out on purpose.
    steps = ([*pip, "--no-deps", "--require-hashes", "-r", HOME / lock],
             [*pip, "--no-deps", "--no-build-isolation", "--no-index", "-e", HOME])
    for step in steps:
        if subprocess.call(step) != 0:
            _stop("the installation did not finish; the lines above say why. Run the same command again to go on")
            return False
    stamp.write_text(wanted)
    return True


def _test(arguments: list[str]) -> int:
    """Lint, types and tests, side by side; every part runs, and the code is that of the first that failed."""
    tests = [PYTHON, "-m", "pytest", *WORKERS, *([] if "--long" in arguments else ["-m", "not long"]),
             *(a for a in arguments if a != "--long")]
    beside = [[PYTHON, "-m", "ruff", "check", "."], [PYTHON, "-m", "mypy"]]
    print(f"→ {' '.join(str(part) for part in tests[2:])}, beside ruff and mypy", file=sys.stderr, flush=True)
    running = [subprocess.Popen(step, cwd=HOME, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) for step in beside]
    # One thread of linear algebra a worker: two workers with two each wait for one another.
    codes = [_call(tests, cwd=HOME, env={"OPENBLAS_NUM_THREADS": "1"} | os.environ)]
    for step, process in zip(beside, running, strict=True):
        said, _ = process.communicate()
        named = " ".join(str(part) for part in step[2:])
        print(f"→ {named}\n{said.decode(errors='replace')}", file=sys.stderr, end="", flush=True)
        codes.append(process.returncode)
    return next((code for code in codes if code), 0)


def _docs(arguments: list[str]) -> int:
    """The site; a broken link or a name that no longer exists is an error (`strict` in mkdocs.yml)."""
    os.environ["NO_MKDOCS_2_WARNING"] = "1"  # of another program's plans
    code = subprocess.call([PYTHON, "-m", "mkdocs", "build", *arguments], cwd=HOME)
    if code == 0:
        print("open exports/docs/index.html", file=sys.stderr)
    return code


def _call(command: list[str | Path], **options: object) -> int:
    """Run a program to its end; an interrupt from the keyboard is the program's own affair."""
    with subprocess.Popen(command, **options) as child:
        while True:
            try:
                return child.wait()
            except KeyboardInterrupt:
                continue


def _stop(message: str) -> int:
    print(f"run.py: {message}", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
