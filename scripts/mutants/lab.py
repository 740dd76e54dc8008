"""A copy of the project to plant faults in; its tests run in children of one process that has the libraries loaded."""

from __future__ import annotations

import compileall
import contextlib
import importlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("mirror_cad", "raytrace", "mirror_studio")
LIBRARIES = ("numpy", "scipy.interpolate", "scipy.optimize", "scipy.sparse.linalg", "scipy.integrate", "scipy.spatial",
             "numba", "OCP.Geom", "OCP.BRepBuilderAPI", "OCP.STEPControl", "OCP.XCAFDoc", "pytest",
             "_pytest.assertion.rewrite", "hypothesis", "pydantic", "ezdxf", "PIL.Image", "trimesh", "embreex",
             "matplotlib.figure", "matplotlib.backends.backend_agg")


@contextlib.contextmanager
def copy_of_project() -> Iterator[Path]:
    """Copy what git does not ignore to a new folder and go there: your own files are not touched, and you may edit on."""
    with tempfile.TemporaryDirectory(prefix="mutants-") as name:
        folder = Path(name)
        for path in project_files():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / path, folder / path)
        for package in PACKAGES:
            for path in (ROOT / package).glob("**/__pycache__"):  # compiled kernels
                shutil.copytree(path, folder / path.relative_to(ROOT), dirs_exist_ok=True)
        work_in(folder)
        yield folder


def project_files() -> list[str]:
    """What git does not ignore."""
    listed = subprocess.run(["git", "ls-files", "-coz", "--exclude-standard"], cwd=ROOT, capture_output=True, check=True,
                            text=True).stdout.split("\0")
    return [path for path in listed if path and (ROOT / path).exists()]


def work_in(folder: Path) -> None:
    """Go to a copy of the project, with the libraries loaded that its tests take."""
    os.chdir(folder)
    sys.path.insert(0, str(folder))
    os.environ["PYTHONPATH"] = str(folder)
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    for package in PACKAGES:
        compileall.compile_dir(package, quiet=1)
    for library in LIBRARIES:
        with contextlib.suppress(ImportError):
            importlib.import_module(library)
    if {"mirror_cad", "raytrace"} & set(sys.modules):
        raise SystemExit("the project was imported before its copy was made: faults in it would not be seen")


def in_child(work: Callable[[], int], timeout_s: float, log: Path) -> tuple[int | None, float]:
    """Run `work` in a forked process group; its exit code (None: out of time) and its seconds."""
    start = time.monotonic()
    child = os.fork()
    if child == 0:
        os.setsid()
        with log.open("wb") as out:
            os.dup2(out.fileno(), 1)
            os.dup2(out.fileno(), 2)
        sys.dont_write_bytecode = True
        os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
        code = 70
        try:
            code = work()
        finally:
            sys.stdout.flush()
            os._exit(code)
    while time.monotonic() - start < timeout_s:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status), time.monotonic() - start
        time.sleep(0.02)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return None, time.monotonic() - start


def pytest_run(files: list[str]) -> int:
    """The exit code of pytest over these files, up to the first failure."""
    import pytest

    return int(pytest.main(["-x", "-q", "-m", "not long", "-p", "no:xdist", "-p", "no:cacheprovider", "--tb=line", *files]))
