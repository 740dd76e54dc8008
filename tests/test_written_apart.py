"""A mirror that is written in the kernel's process is the one that is written here, and this process has no kernel."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirror_cad import kernel
from mirror_cad.design_stages import design
from mirror_cad.errors import SolidError, WriteError
from mirror_cad.guarded import FallenError
from mirror_cad.mirror import Mirror
from mirror_cad.occt.solid import area
from mirror_cad.occt.step import read_step
from mirror_cad.plate_files import PlateFiles, ReadStep
from mirror_studio.build import checks
from mirror_studio.build.pipeline import build
from mirror_studio.drive.mirrors import exported
from mirror_studio.progress import Progress
from raytrace.assembly import FRONT_FACE, OPTICAL_FACE
from raytrace.cad_reflector import plate_reflector
from raytrace.load import load_reflector
from raytrace.reflector import OBSTACLE_DEFLECTION_MM
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


@pytest.mark.parametrize("kind", KINDS)
def test_a_plate_written_and_read_apart_is_the_one_written_and_read_here(kind: str, tmp_path: Path,
                                                                         monkeypatch: pytest.MonkeyPatch) -> None:
    """To the byte and to the bit; and its reflector is the one that its file is loaded as."""
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    kernel._process.close()
    radius = 1e12 if kind == "flat" else 1250.0
    mirror = design(spec_of(constant(radius), constant(radius), **KINDS[kind])).as_made
    here, sheet_here, apart, sheet_apart = (tmp_path / f"{name}.step" for name in ("a", "a-sheet", "b", "b-sheet"))
    mirror.export_step(here)
    mirror.export_surface_step(sheet_here)
    called: list[int] = []
    plate = mirror.export_steps_apart(apart, sheet_apart, OBSTACLE_DEFLECTION_MM, lambda: called.append(1))
    assert called == [1]
    assert here.read_bytes() == apart.read_bytes()
    assert sheet_here.read_bytes() == sheet_apart.read_bytes()
    assert (plate.area_mm2, plate.volume_mm3) == (mirror.plate.area_mm2, mirror.plate.volume_mm3)
    read = read_step(here)
    for face in plate.step.faces:
        surface, there = face.surface, read.named_surface(face.name)
        assert np.array_equal(surface.poles, there.poles)
        assert np.array_equal(surface.knots_u, there.knots_u)
        assert np.array_equal(surface.knots_v, there.knots_v)
        assert face.area_mm2 == area(next(each.raw for each in read.faces if each.name == face.name))
    fronts = [face.shape for face in plate.step.faces if face.name == FRONT_FACE]
    assert len(fronts) == (kind == "glass before its back")
    ours = plate_reflector(plate.step.named(OPTICAL_FACE).shape, fronts, plate.step.sides, 1.52)
    loaded = load_reflector(here, index=1.52)
    eye = np.array([0.0, 0.0, 762.0])
    x, y = (each.ravel() for each in np.meshgrid(np.linspace(-120.0, 120.0, 19), np.linspace(-120.0, 120.0, 19)))
    rays = np.stack([x, y, np.full(x.size, -762.0)], axis=1)
    one, other = (reflect(each, eye, rays / np.linalg.norm(rays, axis=1, keepdims=True)) for each in (ours, loaded))
    assert np.array_equal(one.status, other.status)
    assert np.array_equal(one.directions, other.directions, equal_nan=True)
    assert (one.status == 0).sum() > 100
    kernel._process.close()


def _damaged(plate: PlateFiles) -> dict[str, tuple[ReadStep, str]]:
    """What may read back wrong, and what is said of it."""
    step, face = plate.step, plate.step.faces[0]
    moved = replace(face.surface, poles=face.surface.poles + [0.0, 0.0, 1e-8])
    line = step.curves[0]
    return {"two solids": (replace(step, solids=2, volume_mm3=None), "reads back as 2 solids, valid"),
            "no valid one": (replace(step, valid=False), "reads back as 1 solids, invalid"),
            "another volume": (replace(step, volume_mm3=plate.volume_mm3 * (1.0 + 1e-8)), "the volume reads back 1e-08 off"),
            "no name": (replace(step, faces=()), "the file has 0 faces named 'optical face', not 1"),
            "a face moved": (replace(step, faces=(replace(face, surface=moved),)),
                             "the optical face is 1e-08 mm from the design"),
            "its line moved": (replace(step, curves=(line + [1e-8, 0.0, 0.0],)), "the transition line reads back 1e-08 mm off"),
            "no line": (replace(step, curves=()), "the transition line reads back inf mm off")}


def test_a_plate_that_reads_back_otherwise_is_refused(tmp_path: Path) -> None:
    mirror = design(spec_of(constant(1250.0), constant(1250.0), part={"transition_mm": -60.0}))
    path, sheet = tmp_path / "a.step", tmp_path / "b.step"
    plate = mirror.export_steps_apart(path, sheet, OBSTACLE_DEFLECTION_MM, lambda: None)
    assert max(checks.check_step(path, plate.step, mirror, plate.volume_mm3)) <= checks.SAME_MM
    assert checks.check_surface_step(sheet, plate.sheet, mirror) <= checks.SAME_MM
    for read, says in _damaged(plate).values():
        with pytest.raises(WriteError, match=re.escape(says)):
            checks.check_step(path, read, mirror, plate.volume_mm3)
    face = plate.sheet.faces[0]
    off = replace(face, surface=replace(face.surface, poles=face.surface.poles + [0.0, 1e-8, 0.0]))
    with pytest.raises(WriteError, match="the sheet is 1e-08 mm from the design"):
        checks.check_surface_step(sheet, replace(plate.sheet, faces=(off,)), mirror)


@pytest.mark.parametrize("kernel_fails", [True, False])
def test_what_the_kernel_says_of_a_plate_goes_before_other_files(kernel_fails: bool, tmp_path: Path,
                                                                 monkeypatch: pytest.MonkeyPatch) -> None:
    written = Mirror.export_steps_apart

    def steps(*arguments: Any) -> PlateFiles:
        files = written(*arguments)
        if kernel_fails:
            raise SolidError("no solid")
        return files

    def stl(*_: object) -> None:
        raise WriteError("no mesh")

    monkeypatch.setattr(Mirror, "export_steps_apart", steps)
    monkeypatch.setattr(Mirror, "export_stl_apart", stl)
    with pytest.raises(SolidError if kernel_fails else WriteError, match="no solid" if kernel_fails else "no mesh"):
        build(spec_of(constant(1250.0), constant(1250.0)), tmp_path / "set", Progress(quiet=True))
    assert list(tmp_path.iterdir()) == []


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


@pytest.mark.parametrize("work", ["from mirror_studio.drive.mirrors import exported\nexported(spec)",
                                  "from pathlib import Path\nfrom mirror_studio.build.pipeline import build\n"
                                  "from mirror_studio.progress import Progress\nbuild(spec, Path(out), Progress(quiet=True))"])
def test_a_mirror_driven_or_built_needs_no_kernel_here(work: str, tmp_path: Path) -> None:
    said = subprocess.run([sys.executable, "-c", "import sys\nfrom mirror_cad.spec.file import load_spec\n"
                           f"spec, out = load_spec('progressive-c'), {str(tmp_path / 'set')!r}\n{work}\n"
                           "print([name for name in sys.modules if name.split('.')[0] in ('OCP', 'matplotlib')])"],
                          capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "[]"
