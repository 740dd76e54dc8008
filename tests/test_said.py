"""What pages and messages say: a miss is seen in its digits, and no key is listed that had no effect."""

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from mirror_cad.spec.file import load_spec, spec_as_json, validate_spec
from mirror_studio.cli import run
from mirror_studio.missed import missed_in_words
from mirror_studio.report.requirement import Requirement
from mirror_studio.report.rows import actual_in_words, requirement_groups
from mirror_studio.report.specification import in_effect, specification_rows
from mirror_studio.report.text import number
from tests.conftest import constant, spec_of


def value_of(text: str) -> float:
    """The number that a text begins with."""
    figure = text.replace("−", "-").replace("\u202f", " ").split("%")[0].strip().replace(" ", "")
    if "·10" in figure:
        mantissa, power = figure.split("·10")
        exponent = power.translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789"))
        return float(mantissa) * 10.0 ** int(exponent)
    return float(figure)


@given(st.floats(1e-9, 1e6), st.floats(-1e-3, 1e-3), st.sampled_from(["size", "least", "most"]), st.booleans())
@example(1.0, 3e-16, "size", False)  # the next double: told by its seventeenth digit alone
def test_a_requirement_is_told_on_the_side_of_its_limit_on_which_it_is(limit: float, off: float, side: str,
                                                                        negative: bool) -> None:
    actual = limit * (1.0 + off)
    row = Requirement("part", "k1", "%", limit, -actual if negative and side == "size" else actual, side=side)  # type: ignore[arg-type]
    said = value_of(actual_in_words(row, sign=True))
    if row.met:
        assert replace(row, actual=said).met or math.isclose(abs(said), limit, rel_tol=1e-15)
    else:
        assert replace(row, actual=said).met is False


def test_the_miss_of_the_report_is_seen_in_its_digits() -> None:
    row = Requirement("part", "k1, realised against designed", "%", 4.641, -4.64132, (88.12, -161.06))
    assert missed_in_words([row]) == ("k1, realised against designed: -4.6413 % at (88.1, -161.1) mm, the limit is 4.641 %",)
    assert missed_in_words([replace(row, limit=4.642)]) == ()
    view = Requirement("view", "lane straightness, traced", "%", 45.5, 45.5004, side="most")
    assert missed_in_words([view]) == ("lane straightness, traced: 45.5004 %, asked for: at most 45.5 %",)
    lost = Requirement("view", "lane straightness, traced", "%", 45.5, math.nan, side="most")
    assert missed_in_words([lost]) == ("lane straightness, traced: not to be measured, asked for: at most 45.5 %",)

    class NoUncertainty:
        def missed(self, key: str) -> float:
            return 0.0

    ((_, [cells]),) = [group for group in requirement_groups([view], NoUncertainty()) if group[1]]  # type: ignore[arg-type]
    assert (cells["actual"], cells["margin"], cells["verdict"]) == ("45.5004\u202f%", "−0.0004\u202f%", "not met")


def test_usual_digits_are_kept_where_they_tell() -> None:
    assert actual_in_words(Requirement("part", "k1", "%", 5.0, -4.64132), sign=True) == "−4.64\u202f%"
    assert actual_in_words(Requirement("part", "k1", "%", None, -4.64132), sign=True) == "−4.64\u202f%"
    assert number(4.9e-8, 3) == "4.9·10⁻⁸"
    assert number(4.91234e-8, 5) == "4.9123·10⁻⁸"


def test_exit_code_3_says_the_digits_of_the_miss(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                                 capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    text = ('name = "m"\n[horizontal]\nlaw = "linear"\nright_mm = 1250.0\nleft_mm = 1000.0\n[vertical]\nlaw = "constant"\n'
            'radius_mm = 1250.0\n[view]\nwidth_px = 32\n[outline]\nwidth_mm = 100\nleft_height_mm = 100\n'
            'right_height_mm = 100\n')
    Path("m.toml").write_text(text)
    assert run(["build", "m.toml", "--out", "first"]) == 0
    total = json.loads(Path("first/deviation.json").read_text())["total"]
    worst = max(abs(total[f"{key}_max_percent"]) for key in ("k1", "k2"))
    limit = float(f"{worst * (1.0 - 1e-5):.8g}")
    Path("m.toml").write_text(text + f"[limits]\ncurvature_percent = {limit!r}\n")
    capsys.readouterr()
    assert run(["build", "m.toml", "--out", "second"]) == 3
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "missed" in line]
    said = abs(float(line.split(": ")[3].split(" %")[0]))
    assert said > limit
    assert f"the limit is {limit:.10g} %" in line


def test_a_report_lists_no_key_that_had_no_effect(tmp_path: Path) -> None:
    spec = spec_of(constant(1250.0), constant(1250.0), outline={"file": "rim.dxf", "layer": "Rim"})
    listed = {key for pair in specification_rows(spec) for key, _ in pair}
    assert {key for key in listed if key.startswith("outline")} == {"outline.file", "outline.layer"}
    assert "glass.index" not in listed
    assert "surface.degree" in listed
    behind = spec_of(constant(1250.0), constant(1250.0), glass={"reflecting": "back"}, surface={"fit": "occt-approximate"})
    listed = {key for pair in specification_rows(behind) for key, _ in pair}
    assert {"glass.index", "outline.width_mm"} <= listed
    assert not {"surface.degree", "surface.spans"} & listed
    assert in_effect(load_spec("progressive-c"))["outline"]["corner_radius_mm"] == 40.0


@pytest.mark.parametrize("outline", [{}, {"width_mm": 200.0}, {"file": "rim.dxf"}, {"file": "rim.svg", "join_mm": 0.05,
                                                                                     "loop": "outermost", "layer": "Rim"}])
def test_a_specification_in_a_manifest_is_one_again(outline: dict[str, object]) -> None:
    spec = spec_of(constant(1250.0), constant(1250.0), outline=outline)
    again = validate_spec(json.loads(json.dumps(spec_as_json(spec))))
    assert again.outline == spec.outline
    assert spec_as_json(again) == spec_as_json(spec)


def test_a_flat_mirror_s_specification_is_one_again() -> None:
    flat = load_spec("flat")
    again = validate_spec(json.loads(json.dumps(spec_as_json(flat), allow_nan=False)))
    assert again.horizontal == flat.horizontal
    assert again.vertical == flat.vertical
