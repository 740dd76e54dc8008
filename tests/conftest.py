"""What several tests share: designed presets, a studio and a browser, made once; and how files are dealt to workers."""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher

import mirror_cad
import raytrace
from mirror_cad.mirror import Mirror
from mirror_cad.spec.file import validate_spec
from raytrace.surfaces.base import OpticalSurface

# The machine is shared: a slow example is no failure.
settings.register_profile("shared", deadline=None, print_blob=True)
settings.load_profile("shared")

PAPER_MIRRORS = ("sphere-1250", "sphere-1050", "sphere-950", "progressive-a", "progressive-b", "progressive-c")

# Files that take long, longest first: what is begun last is short, so that the workers end together.
LONGEST = ("test_studio_browser", "test_studio_road", "test_studio_wire", "test_tracing", "test_cad_files", "test_lit_world",
           "test_files", "test_said", "test_guarded", "test_hard_cases", "test_interrupt", "test_desktop", "test_fuzz_texts",
           "test_bench_tracing", "test_drive")
# Files whose fixtures are one thing for all: a group runs on one worker.
GROUPS = {"test_studio_browser": "studio", "test_studio_road": "studio", "test_studio_wire": "studio"}


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give each test to the group of its file, long files first (`--dist loadgroup`)."""
    rank = {name: k for k, name in enumerate(LONGEST)}
    items.sort(key=lambda item: rank.get(item.path.stem, len(rank)))
    for item in items:
        if item.get_closest_marker("xdist_group") is None:
            item.add_marker(pytest.mark.xdist_group(GROUPS.get(item.path.stem, item.path.stem)))


@contextlib.contextmanager
def _locked(name: str) -> Iterator[None]:
    """Hold a lock among processes; the system frees it where one dies."""
    key = hashlib.sha256(f"{os.getuid()} {name}".encode()).hexdigest()[:24]
    with (Path(tempfile.gettempdir()) / f"mirror-cad-tests-{key}.lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def pytest_configure(config: pytest.Config) -> None:
    """Let one worker compile a kernel while the others wait for it, and load it from numba's cache then."""
    if not hasattr(config, "workerinput"):
        return
    compile_here = Dispatcher.compile

    def compile_once(self: Dispatcher, signature: Any) -> Any:
        function = self.py_func
        # numba's own lock first: with it a thread may compile the functions that this one calls.
        with global_compiler_lock, _locked(f"{function.__code__.co_filename} {function.__qualname__}"):
            return compile_here(self, signature)

    Dispatcher.compile = compile_once


@cache
def designed(name: str) -> Mirror:
    """A preset, designed once for all tests."""
    return mirror_cad.design(mirror_cad.load_spec(name))


def face_of(mirror: Mirror) -> OpticalSurface:
    """The mirror's reflecting face, inside its outline, without glass before it."""
    return raytrace.Reflector.from_mirror(mirror).uncoated.surface


def spec_of(horizontal: dict[str, Any], vertical: dict[str, Any], **sections: Any) -> mirror_cad.MirrorSpec:
    """A specification from dictionaries."""
    return validate_spec({"name": "test", "horizontal": horizontal, "vertical": vertical, **sections})


def constant(radius: float) -> dict[str, Any]:
    """A constant law."""
    return {"law": "constant", "radius_mm": radius}


@pytest.fixture
def spec_file(tmp_path: Path) -> Callable[[str], Path]:
    """Write a specification's text to a file."""

    def write(text: str, name: str = "spec.toml") -> Path:
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write
