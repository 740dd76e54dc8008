"""What is said on the standard error while something takes long."""

from __future__ import annotations

import pytest
from numba import njit

from mirror_studio.compiling import SAID
from mirror_studio.progress import Progress


def test_compiling_is_said_once_and_what_is_compiled_already_is_not(capsys: pytest.CaptureFixture[str]) -> None:
    double, triple = njit(lambda x: 2.0 * x), njit(lambda x: 3.0 * x)
    progress = Progress()
    progress.step("designing")
    assert SAID not in capsys.readouterr().err
    assert double(1.0) + triple(1.0) == 5.0
    assert capsys.readouterr().err.count(SAID) == 1
    assert double(2.0) == 4.0
    progress.step("tracing")
    assert SAID not in capsys.readouterr().err
