"""A measure is one file: registered once, it is in tables, files, the report and the page."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from mirror_cad.spec.file import load_spec
from mirror_studio.build.pipeline import build
from mirror_studio.cli import run
from mirror_studio.progress import Progress
from mirror_studio.rules.figures import rule_figures_known
from raytrace.measures.in_use import MirrorInUse
from raytrace.measures.registry import Measure, measures_of, register, registered, unregister

# What outside checks hold on to.
CONTRACT = {"h_fov_section_deg", "h_fov_traced_deg", "v_fov_left_section_deg", "v_fov_left_traced_deg",
            "lane_straightness_percent"}


def aspect(use: MirrorInUse) -> float:
    """Height over width of the mirror's box."""
    x_min, x_max, y_min, y_max = use.box
    return (y_max - y_min) / (x_max - x_min)


@pytest.fixture
def measure() -> Iterator[Measure]:
    yield register(Measure("box_aspect", "height over width", "", 3, "of the mirror's box", aspect, "setup", "Size"))
    unregister("box_aspect")


def test_a_measure_registered_here_is_in_files_report_and_table(measure: Measure, tmp_path: Path) -> None:
    built = build(load_spec("flat"), tmp_path / "flat", Progress())
    x_min, x_max, y_min, y_max = built.mirror.box
    expected = (y_max - y_min) / (x_max - x_min)
    figures = json.loads((tmp_path / "flat" / "metrics.json").read_text("utf-8"))["measures"]
    assert figures["box_aspect"] == pytest.approx(expected, rel=1e-15)
    assert "height over width" in (tmp_path / "flat" / "report.html").read_text("utf-8")
    assert "measures.box_aspect" in (tmp_path / "flat" / "flat-measures.csv").read_text("utf-8")


def test_a_measure_registered_here_is_on_the_page(measure: Measure) -> None:
    from mirror_studio.web import engine
    from mirror_studio.web.protocol import ViewSettings

    shown = engine.show(load_spec("flat"), ViewSettings()).header["measures"]
    assert [one["name"] for one in shown] == ["box_aspect"]
    assert shown[0]["title"] == "height over width"
    assert isinstance(shown[0]["value"], float)


def test_the_command_lists_every_measure(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["measures"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == [*registered(), *rule_figures_known()]
    assert set(registered()) >= CONTRACT
    assert all(one.definition for one in registered().values())


def test_a_name_that_no_file_could_have_is_refused() -> None:
    with pytest.raises(ValueError, match="letters, digits and underscores"):
        register(Measure("two words", "", "", 0, "", aspect))
    with pytest.raises(ValueError, match="group 'Odd' is none of"):
        register(Measure("odd", "", "", 0, "", aspect, group="Odd"))


def test_measures_of_a_mirror_alone_need_no_vehicle() -> None:
    import raytrace
    from tests.conftest import designed

    use = MirrorInUse(raytrace.View(raytrace.Reflector.from_mirror(designed("sphere-950"))), raytrace.Lane(0.0, 2400.0, 0.6))
    found = measures_of(use)
    assert {one.scope for one in found.values()} == {"setup"}
    assert found["h_fov_traced_deg"].value(use) == pytest.approx(44.64, abs=0.01)
    with pytest.raises(ValueError, match="on a vehicle"):
        _ = use.on_vehicle


def test_any_measure_may_be_limited_by_its_name(tmp_path: Path, spec_file: Callable[[str], Path],
                                                capsys: pytest.CaptureFixture[str]) -> None:
    text = """
name = "ball"
[horizontal]
law = "constant"
radius_mm = 950.0
[vertical]
law = "constant"
radius_mm = 950.0
[limits]
h_fov_traced_deg = [44.0, 44.5]
"""
    assert run(["build", str(spec_file(text)), "--out", str(tmp_path / "ball")]) == 3
    assert "horizontal field of view, traced: 44.64" in capsys.readouterr().err
    wrong = spec_file(text.replace("h_fov_traced_deg", "h_fov_trace_deg"))
    assert run(["build", str(wrong), "--out", str(tmp_path / "b")]) == 2
    assert "did you mean 'h_fov_traced_deg'" in capsys.readouterr().err
