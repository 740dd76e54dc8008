"""Rules as data against what was found of them, a sheet of each by the command line, and what is refused."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mirror_cad.errors import SpecError
from mirror_studio.cli import BAD_INPUT, DONE, MISSED, run
from mirror_studio.rules.measuring import RuleQuantities
from mirror_studio.rules.mounted import Mounted
from mirror_studio.rules.schema import QUANTITIES, LineSection, RuleFile, load_rule, rule_names
from mirror_studio.rules.shape import RECTANGLE_MM
from mirror_studio.rules.verdicts import TAKE, judged
from raytrace.reflector import Reflector
from raytrace.viewing.pose import Pose
from tests.rule_mirrors import measured, sphere, torus
from tests.test_rule_fields import CENTRE, EYES, HOST
from tests.test_spherometer import line

FOUND = Path(__file__).parent / "files" / "rules-found.md"

HEAD = '''rule = "own"
title = "a rule of one's own"
edition = "1"
classes = ["A"]
default_class = "A"
wording = "none"
[[line]]
paragraph = "1"
text = "the radius"
quantity = "radius_r_mm"
unit = "mm"
limit = [1000.0, inf]
measured = "as it is"
checked = "read"
'''


def section(title: str) -> str:
    return FOUND.read_text("utf-8").split(f"## {title}")[1].split("\n## ")[0]


def numbers(text: str) -> set[float]:
    return {float(each) for each in re.findall(r"\d+(?:\.\d+)?", text.replace("–", " "))}


def numbers_of(lines: tuple[LineSection, ...]) -> set[float]:
    """Every number of the lines' limits, formulas, fields and conditions."""
    found: set[float] = set()
    for each in lines:
        found |= set(each.limit or ())
        if each.least_of_radius is not None:
            found |= {each.least_of_radius.numerator_mm, each.least_of_radius.over_mm}
        if each.field is not None:
            found |= {abs(end) for row in each.field.rows_m for end in row} | {each.field.corner_radius_m}
        if each.when is not None:
            found |= {each.when.least, each.when.below}
    return {each for each in found if abs(each) != float("inf")}


# --- transcription ----------------------------------------------------------------------------------------------------


def test_every_number_of_the_table_is_in_its_class() -> None:
    """Row by row of UN R46: the radius, the rectangle's formula, b, and the field's widths and distances."""
    rows = re.findall(r"^\| (I|II|III|IV|V|VI|VII) \|(.+)\|(.+)\|(.+)\|$", section("UN R46, 03 series (read)"), re.MULTILINE)
    assert [row[0] for row in rows] == ["I", "II", "III", "IV", "V", "VI", "VII"]
    for name, radius, size, field in rows:
        lines = load_rule("R46").lines_of(name)
        wanted = numbers(radius) | (numbers(size.replace("(1 +", "(")) if "field only" not in size else set())
        ground = re.sub(r"\([^)]*\)", "", field)  # without areas, which have a test of their own
        wanted |= numbers(ground.replace("20 m wide", "10 m to each side") if name == "I" else ground)
        known = numbers_of(lines) | {RECTANGLE_MM}
        assert wanted <= known, (name, wanted - known)


def test_every_number_of_the_rule_files_was_found() -> None:
    """The other way round: no limit, formula or field that the transcription does not have."""
    own = {"R46": {0.0, 10.0, 0.02, 15.0, 25.0, 0.99}, "FMVSS111": {0.0, 0.5}, "GB15084": {0.0, 10.0, 0.02, 15.0, 25.0, 0.99}}
    titles = {"R46": ("UN R46, 03 series (read)",), "FMVSS111": ("FMVSS 111 (571.111)",),
              "GB15084": ("UN R46, 03 series (read)", "GB 15084-2022 (read)")}
    for name in ("R46", "GB15084", "FMVSS111"):
        text = "".join(map(section, titles[name]))
        found = numbers(text) | {100.0 * each for each in numbers(text)}  # 0.15 r is 15 %
        left = numbers_of(load_rule(name).line) - found - own[name]
        assert not left, (name, left)


@pytest.mark.parametrize(("name", "class_name", "quantity", "limit"), [
    ("R46", "II", "radius_r_mm", (1200.0, float("inf"))), ("R46", "VII", "radius_r_mm", (1000.0, 1500.0)),
    ("R46", "III", "segment_b_mm", (70.0, float("inf"))), ("R46", "I", "field_obstructed_percent", (0.0, 15.0)),
    ("R46", "IV", "field_obstructed_percent", (0.0, 10.0)), ("R46", "II", "mirror_angle_deg", (0.0, 55.0)),
    ("R46", "II", "reflectance_percent", (40.0, float("inf"))), ("R46", "II", "radius_least_mm", (150.0, float("inf"))),
    ("FMVSS111", "passenger", "radius_r_mm", (889.0, 1651.0)),
    ("FMVSS111", "passenger", "radius_ri_spread_percent", (0.0, 12.5)),
    ("GB15084", "II", "radius_r_mm", (1200.0, float("inf")))])
def test_limits_as_found(name: str, class_name: str, quantity: str, limit: tuple[float, float]) -> None:
    assert [each.limit for each in load_rule(name).lines_of(class_name) if each.quantity == quantity] == [limit]


def test_spreads_change_at_three_metres() -> None:
    for quantity in ("radius_ri_spread_percent", "radius_rp_spread_percent"):
        below, above = (each for each in load_rule("R46").lines_of("II") if each.quantity == quantity)
        assert (below.limit, above.limit) == ((0.0, 15.0), (0.0, 25.0))
        assert below.when is not None
        assert above.when is not None
        assert below.when.below == above.when.least == 3000.0


def test_every_quantity_is_measured_and_every_line_says_how_sure_it_is() -> None:
    assert set(TAKE) == set(QUANTITIES)
    for name in rule_names():
        for each in load_rule(name).line:
            assert each.quantity in TAKE
            assert each.measured
            assert each.checked in ("read", "said", "memory")
    assert {each.checked for each in load_rule("r46-04").line} == {"memory"}  # its text was not obtained


# --- verdicts ---------------------------------------------------------------------------------------------------------


def mounted(reflector: Reflector, rule: str = "R46") -> RuleQuantities:
    pose = Pose(CENTRE, np.zeros(3), np.radians(22.0), np.radians(3.0))
    return measured(reflector, rule).mounted_as(Mounted(pose, EYES, HOST))


def test_freeform_mirror_is_open_where_the_wording_is() -> None:
    of = judged(mounted(torus(1400.0, 1250.0, 180.0, 240.0)), "III")
    departure = line(of, "sphere_departure_mm")
    assert departure.verdict == "open"
    assert "04 series Supplement 9 admits freeform mirrors: check the official text" in departure.notes[-1]
    assert line(judged(mounted(sphere(1250.0, 180.0, 240.0)), "III"), "sphere_departure_mm").verdict == "met"


def test_gb_counts_no_field_of_an_aspheric_mirror() -> None:
    """What a sphere meets is open for a torus that shows as much."""
    round_one, other = sphere(1250.0, 200.0, 280.0), torus(1400.0, 1250.0, 200.0, 280.0)
    verdicts = [line(judged(mounted(each, rule), "III"), "field_missing_m2").verdict for each in (round_one, other)
                for rule in ("R46", "GB15084")]
    assert verdicts == ["met", "met", "met", "open"]


def test_gb_asks_more_of_a_high_class_v() -> None:
    """Below 2.4 m only 2 m outward are asked for, above also 4.5 m."""
    m = mounted(sphere(400.0), "GB15084")
    assert sum(each.asked.quantity == "field_missing_m2" for each in judged(m, "V")) == 1
    there = m.on_vehicle.mounted
    high = m.mounted_as(replace(there, pose=replace(there.pose, centre=CENTRE + [0.0, 0.0, 900.0])))
    assert sum(each.asked.quantity == "field_missing_m2" for each in judged(high, "V")) == 2


def test_side_decides_which_of_class_vii() -> None:
    """A left-hand mirror of a driver on the left shows 2.5 m from 10 m."""
    of = line(judged(mounted(sphere(1250.0)), "VII"), "field_missing_m2")
    assert of.asked.side == "driver"
    assert "2.5 m" in of.asked.text


def test_without_a_vehicle_fields_are_open() -> None:
    of = line(judged(measured(sphere(1250.0)), "II"), "field_missing_m2")
    assert (of.value, of.verdict) == (None, "open")
    assert "--vehicle" in of.notes[0]


# --- the command ------------------------------------------------------------------------------------------------------


def test_sheet_of_the_papers_first_mirror(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its radius at x = 0 is 1175 mm: below class II's 1200, which exit code 3 says."""
    out = tmp_path / "out"
    arguments = ["progressive-a", "--rule", "R46", "--class", "II", "--vehicle", "motorway", "--out", str(out)]
    assert run(["rules", *arguments]) == MISSED
    assert "radius_r_mm = 1175" in capsys.readouterr().err
    content = json.loads((out / "rules.json").read_text("utf-8"))
    assert (content["rule"], content["edition"], content["class"]) == ("R46", "03 series of amendments", "II")
    by_name = {each["quantity"]: each for each in content["lines"]}
    assert {"paragraph", "quantity", "value", "unit", "limit", "margin", "verdict", "checked"} <= set(by_name["radius_r_mm"])
    assert by_name["radius_r_mm"]["verdict"] == "missed"
    assert by_name["radius_r_mm"]["value"] == pytest.approx(1175.0, abs=1.0)
    assert by_name["radius_r_mm"]["limit"] == [1200.0, None]
    assert by_name["radius_r_mm"]["margin"] == pytest.approx(by_name["radius_r_mm"]["value"] - 1200.0)
    assert by_name["field_missing_m2"]["verdict"] == "met"
    with (out / "rules.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    for row, one in zip(rows, content["lines"], strict=True):
        assert (row["quantity"], row["verdict"]) == (one["quantity"], one["verdict"])
    assert float(rows[0]["value"]) == by_name["radius_r_mm"]["value"]
    page = (out / "rules.html").read_text("utf-8")
    assert "official text decides" in page
    assert "<svg" in page
    for file in out.iterdir():
        assert "complies" not in file.read_text("utf-8").lower(), file


def test_sphere_of_1250_meets_the_american_passenger_side(tmp_path: Path) -> None:
    out = tmp_path / "out"
    arguments = ["sphere-1250", "--rule", "FMVSS111", "--class", "passenger", "--leg-mm", "50", "--out", str(out)]
    assert run(["rules", *arguments]) == DONE
    content = json.loads((out / "rules.json").read_text("utf-8"))
    assert content["spherometer"] == {"leg_mm": 50.0, "checked": "stated"}
    assert [each["verdict"] for each in content["lines"]] == ["met", "met"]
    assert len(content["radii_mm"]) == 5


def test_rule_of_ones_own(tmp_path: Path, spec_file: Callable[..., Path]) -> None:
    """A number is corrected without touching code."""
    own = spec_file(HEAD.replace("1000.0", "1300.0"), "own.toml")
    assert run(["rules", "sphere-1250", "--rule", str(own), "--out", str(tmp_path / "out")]) == MISSED


@pytest.mark.parametrize(("arguments", "said"), [
    (["sphere-1250", "--rule", "R46", "--class", "VIII"], ["--class VIII", "I, II, III, IV, V, VI, VII"]),
    (["sphere-1250", "--rule", "FMVSS111", "--class", "II"], ["--class II", "driver, passenger, inside"]),
    (["sphere-1250", "--rule", "R47"], ["--rule R47", "R46"]),
    (["sphere-1250", "--rule", "R46", "--leg-mm", "0.5"], ["--leg-mm 0.5", "from 1 to 300"]),
    (["sphere-1250", "--rule", "R46", "--reflectance-percent", "140"], ["--reflectance-percent 140", "0 to 100"]),
    (["sphere-1250", "--rule", "R46", "--vehicle", "motorwy"], ["motorwy", "did you mean the scene 'motorway'"])])
def test_what_is_refused(arguments: list[str], said: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert run(["rules", *arguments, "--out", str(out)]) == BAD_INPUT
    told = capsys.readouterr().err
    assert all(each in told for each in said), told
    assert not out.exists()


def test_vehicle_without_eye_points(tmp_path: Path, spec_file: Callable[..., Path], capsys: pytest.CaptureFixture[str]) -> None:
    scene = spec_file('name = "blind"\n[mirror]\nhand = "left"\n', "blind.toml")
    assert run(["rules", "sphere-1250", "--rule", "R46", "--vehicle", str(scene), "--out", str(tmp_path / "out")]) == BAD_INPUT
    assert "no ocular points: put [eyes] with middle_m" in capsys.readouterr().err


def test_mirror_that_the_eye_does_not_see(tmp_path: Path, spec_file: Callable[..., Path], capsys: pytest.CaptureFixture[str],
                                          ) -> None:
    scene = spec_file('name = "away"\n[eyes]\nmiddle_m = [0.0, -0.49, 1.9]\n[mirror]\nyaw_deg = -80.0\npitch_deg = 0.0\n',
                      "away.toml")
    assert run(["rules", "sphere-1250", "--rule", "R46", "--vehicle", str(scene), "--out", str(tmp_path / "out")]) == BAD_INPUT
    assert "is behind the face of the mirror, which is turned away from it" in capsys.readouterr().err


RULE_FAULTS = {
    "unknown key": (HEAD + "limt = 3\n", ["line.0.limt", "did you mean 'limit'"]),
    "unknown unit": (HEAD.replace('unit = "mm"', 'unit = "inch"'), ["line.0.unit", "inch"]),
    "another unit": (HEAD.replace('unit = "mm"', 'unit = "%"'), ["radius_r_mm has the unit 'mm', not '%'"]),
    "unknown quantity": (HEAD.replace('"radius_r_mm"', '"radius_mm"'), ["line.0.quantity", "must be one of radius_r_mm"]),
    "limit that falls": (HEAD.replace("[1000.0, inf]", "[3.0, 2.0]"), ["limit = [3, 2] must rise"]),
    "class that is not there": (HEAD + 'classes = ["B"]\n', ["class 'B'", "A"]),
    "field without ground": (HEAD.replace('"radius_r_mm"', '"field_missing_m2"').replace('unit = "mm"', 'unit = "m²"'),
                             ["field_missing_m2 needs a field"]),
    "field that goes back": (HEAD + "field = { rows_m = [[4.0, 0.0, 1.0], [3.0, 0.0, 1.0]] }\n", ["rising x"]),
    "endless field that widens": (HEAD + "field = { rows_m = [[4.0, 0.0, 1.0], [inf, 0.0, 2.0]] }\n", ["as wide at inf"]),
}


@pytest.mark.parametrize("name", RULE_FAULTS)
def test_fault_of_a_rule_file(name: str, spec_file: Callable[..., Path]) -> None:
    text, said = RULE_FAULTS[name]
    with pytest.raises(SpecError) as caught:
        load_rule(str(spec_file(text, "own.toml")))
    assert all(each in str(caught.value) for each in said), str(caught.value)


def test_rule_of_ones_own_in_python() -> None:
    rule = RuleFile(rule="own", title="own", edition="1", classes=("A",), default_class="A", wording="none")
    assert rule.lines_of("A") == ()
    assert rule.class_named(None) == "A"
