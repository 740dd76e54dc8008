"""What a script meets: one name, one thing; a wrong argument is told what to pass instead."""

from __future__ import annotations

import json
import types
from pathlib import Path

import numpy as np
import pytest

import mirror_cad as mc
import raytrace as rt


@pytest.fixture(scope="module")
def mirror() -> mc.Mirror:
    return mc.design(mc.load_spec("sphere-1250"))


def test_a_package_lists_its_vocabulary_alone() -> None:
    assert dir(mc) == sorted(mc.__all__)
    assert dir(rt) == sorted(rt.__all__)


def test_a_file_of_measures_is_itself_whatever_was_imported_before() -> None:
    before = rt.measures.disparity
    rt.measures.registered()
    assert isinstance(before, types.ModuleType)
    assert rt.measures.disparity is before
    with pytest.raises(AttributeError, match="has no attribute 'no_such_measure'"):
        _ = rt.measures.no_such_measure


def test_the_sag_of_one_point_is_a_number(mirror: mc.Mirror) -> None:
    sag = mirror.surface.sag(50.0, 100.0)
    assert json.loads(json.dumps(sag)) == sag
    assert mirror.surface.sag([50.0], 100.0).shape == (1,)


def test_rays_to_a_point_of_the_surface_meet_it_there(mirror: mc.Mirror) -> None:
    view = rt.View(rt.Reflector.from_mirror(mirror))
    _, traced = view.trace_over(np.array([50.0]), np.array([100.0]))
    assert np.abs(traced.on_mirror[0] - [50.0, 100.0, mirror.surface.sag(50.0, 100.0)]).max() < 1e-9
    assert np.abs(view.trace(50.0, 100.0).on_mirror[0, :2] - [50.0, 100.0]).max() > 0.1


def test_a_wrong_argument_is_told_what_makes_a_right_one(mirror: mc.Mirror) -> None:
    with pytest.raises(TypeError, match=r"takes a MirrorSpec, not str: load_spec"):
        mc.design("progressive-c")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"takes a Reflector, not str: load_reflector"):
        rt.View("mirror.step")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"Mirror is no path: Reflector.from_mirror"):
        rt.load_reflector(mirror)  # type: ignore[arg-type]


def test_a_step_file_is_written_where_it_can_be_read_again(mirror: mc.Mirror, tmp_path: Path) -> None:
    with pytest.raises(mc.WriteError, match=r"there is no folder .*nowhere: make it first"):
        mirror.export_step(tmp_path / "nowhere" / "mirror.step")
    with pytest.raises(mc.WriteError, match=r"a STEP file's name ends in \.step or \.stp"):
        mirror.export_step(tmp_path / "mirror.foo")
    assert not any(tmp_path.iterdir())
