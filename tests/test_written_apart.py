"""A mirror that is written in the kernel's process is the one that is written here, and this process has no kernel."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirror_cad import kernel
from mirror_cad.design_stages import design
from mirror_cad.errors import SolidError, WriteError
from mirror_cad.guarded import FallenError
from mirror_studio.drive.mirrors import exported
from raytrace.load import load_reflector
from raytrace.trace import reflect
from tests.conftest import constant, spec_of

KINDS: dict[str, dict[str, Any]] = {
    "left": {}, "right, with a transition": {"part": {"hand": "right", "transition_mm": -60.0}},
    "glass before its back": {"glass": {"reflecting": "back", "thickness_mm": 2.0}}, "flat": {}}


@pytest.mark.parametrize("kind", KINDS)
def test_both_ways_write_the_same_bytes(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    kernel._process.close()  # the child takes its clock with it
    radius = 1e12 if kind == "flat" else 1250.0
    mirror = design(spec_of(constant(radius), constant(radius), **KINDS[kind]))
    mirror.export_step(tmp_path / "here.step")
    mirror.export_step_apart(tmp_path / "apart.step")
    assert (tmp_path / "here.step").read_bytes() == (tmp_path / "apart.step").read_bytes()
    kernel._process.close()


def test_an_exported_mirror_is_that_of_its_file(tmp_path: Path) -> None:
    spec = spec_of(constant(1250.0), constant(900.0))
    design(spec).export_step(tmp_path / "test.step")
    file, read = load_reflector(tmp_path / "test.step"), exported(spec)
    assert np.array_equal(file.outline(), read.outline())
    eye = np.array([0.0, 0.0, 762.0])
    x, y = (each.ravel() for each in np.meshgrid(np.linspace(-90.0, 90.0, 19), np.linspace(-90.0, 90.0, 19)))
    rays = np.stack([x, y, np.full(x.size, -762.0)], axis=1)
    here, there = (reflect(each, eye, rays / np.linalg.norm(rays, axis=1, keepdims=True)) for each in (file, read))
    assert (here.status == 0).all()
    assert np.array_equal(here.directions, there.directions)


def test_what_cannot_be_written_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mirror = design(spec_of(constant(1250.0), constant(1250.0)))
    with pytest.raises(WriteError, match="there is no folder"):
        mirror.export_step_apart(tmp_path / "no such folder" / "m.step")

    def falls(*_: object, **__: object) -> None:
        raise FallenError("it broke down (SIGSEGV)")

    monkeypatch.setattr(kernel._process, "call", falls)
    with pytest.raises(SolidError, match=r"test: the CAD kernel cannot make a solid of it: it broke down \(SIGSEGV\)"):
        mirror.export_step_apart(tmp_path / "m.step")


def test_an_exported_mirror_needs_no_kernel_here() -> None:
    said = subprocess.run([sys.executable, "-c", "import sys\nfrom mirror_cad.spec.file import load_spec\n"
                           "from mirror_studio.drive.mirrors import exported\nexported(load_spec('progressive-c'))\n"
                           "print([name for name in sys.modules if name.split('.')[0] in ('OCP', 'matplotlib', 'ezdxf')])"],
                          capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "[]"
