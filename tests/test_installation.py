"""What is said where the kernel or Embree is not installed as it should be, and what the files of the set-up promise."""

from __future__ import annotations

import os
import re
import runpy
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

import mirror_cad
from mirror_cad.occt.kernel import SERIES, check_kernel_for_cadquery
from mirror_studio.cli import run
from raytrace.embree import TriangleScene
from tests.conftest import designed

HOME = Path(__file__).resolve().parent.parent
LOCKS = ("requirements.lock", "requirements-test.lock")
SQUARE = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]), np.array([[0, 1, 2], [0, 2, 3]])


@pytest.mark.parametrize(("files", "words"), [
    ({}, "No module named 'OCP'"),
    # What is left of two distributions over each other once one of them is uninstalled; and its __init__ without the library.
    ({"gp.pyi": ""}, "only remains of it"),
    ({"__init__.py": "from OCP.OCP import *"}, "not here, or not whole (No module named 'OCP.OCP')"),
    ({"__init__.py": "__version__ = '7.8.1.1'"}, f"OCP is 7.8.1.1 here, and {SERIES}x is needed"),
    ({"__init__.py": "raise ImportError('libGL.so.1: cannot open shared object file')"}, "apt-get install libgl1"),
])
def test_a_kernel_that_is_not_whole_or_not_the_right_one_is_named_with_what_mends_it(files: dict[str, str], words: str,
                                                                                     tmp_path: Path) -> None:
    """In a Python that sees this package and that kernel, and nothing else that is installed (-S)."""
    for name, text in files.items():
        (tmp_path / "OCP").mkdir(exist_ok=True)
        (tmp_path / "OCP" / name).write_text(text)
    result = subprocess.run([sys.executable, "-S", "-c", "import mirror_cad.occt.convert"], capture_output=True, text=True,
                            env=os.environ | {"PYTHONPATH": f"{tmp_path}{os.pathsep}{HOME}"})
    last = result.stderr.splitlines()[-1]
    assert last.startswith("mirror_cad.errors.InstallationError: ")
    assert words in last
    assert "python -m pip install" in last or "apt-get install" in last


def test_without_the_door_to_vtk_cadquery_alone_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """As it is where cadquery-ocp-novtk was written over cadquery-ocp."""
    import OCP

    monkeypatch.delattr(OCP, "IVtkOCC")
    mirror = designed("sphere-950")
    assert mirror.to_build123d().volume > 0.0
    with pytest.raises(mirror_cad.InstallationError, match="cadquery-ocp-novtk lies over .* uninstall -y cadquery-ocp-novtk"):
        mirror.to_cadquery()
    monkeypatch.undo()
    check_kernel_for_cadquery()
    assert mirror.to_cadquery().val().isValid()


def test_without_embree_triangles_are_refused_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "embreex.mesh_construction", None)
    with pytest.raises(mirror_cad.InstallationError, match="embreex cannot be imported"):
        TriangleScene(*SQUARE)
    monkeypatch.undo()
    assert TriangleScene(*SQUARE).occluded([0.5, 0.25, 1.0], [[0.0, 0.0, -1.0]]).tolist() == [True]


def test_run_py_the_package_and_its_classifiers_name_the_same_pythons() -> None:
    project = tomllib.loads((HOME / "pyproject.toml").read_text("utf-8"))["project"]
    first, beyond = re.fullmatch(r">=3\.(\d+),<3\.(\d+)", project["requires-python"]).groups()
    minors = [f"3.{minor}" for minor in range(int(first), int(beyond))]
    assert [c.rsplit(" ", 1)[1] for c in project["classifiers"] if "Python ::" in c] == minors
    assert [f"{major}.{minor}" for major, minor in runpy.run_path(str(HOME / "run.py"))["PYTHONS"]] == minors


@pytest.mark.parametrize("name", LOCKS)
def test_a_lock_holds_one_kernel_and_one_vtk(name: str) -> None:
    text = (HOME / name).read_text("utf-8")
    assert re.findall(r"^cadquery-ocp(?:-novtk)?==.*?(?= \\)", text, re.M) == [f"cadquery-ocp=={_locked(text, 'cadquery-ocp')}"]
    assert _locked(text, "cadquery-ocp").startswith(SERIES)
    assert len(re.findall(r"^vtk(?:-\w+)*==", text, re.M)) == 1


def test_both_locks_hold_the_same_versions() -> None:
    run, test = (set(re.findall(r"^[\w.-]+==[^\s;]+", (HOME / name).read_text("utf-8"), re.M)) for name in LOCKS)
    assert run <= test


def _locked(text: str, name: str) -> str:
    return re.search(rf"^{re.escape(name)}==(\S+)", text, re.M).group(1)


def test_the_command_says_the_version_of_what_is_installed(capsys: pytest.CaptureFixture[str]) -> None:
    stated = tomllib.loads((HOME / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    assert run(["--version"]) == 0
    assert capsys.readouterr().out.strip() == stated
