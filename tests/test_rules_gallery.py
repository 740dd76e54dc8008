"""The worked cases of docs/rules: each row of the table is what the command finds."""

from __future__ import annotations

import re
import time
from pathlib import Path

import pytest

from mirror_cad.design_stages import design
from mirror_cad.spec.file import load_spec
from mirror_studio.rules.run import RuleRequest, measured_mirror, scene_with_eyes
from mirror_studio.rules.schema import load_rule
from mirror_studio.rules.verdicts import judged
from tests.test_spherometer import line

GALLERY = Path(__file__).parent.parent / "docs" / "rules"
ROW = re.compile(r"^\| `([^`]+)` \| (\w+) (\w+) \| `([^`]+)` \| ([^|]+) \| ([^|]+) \| ([^|]+) \|$", re.MULTILINE)


def rows() -> list[tuple[str, ...]]:
    return ROW.findall((GALLERY / "README.md").read_text("utf-8"))


def case(mirror: str, rule_name: str, class_name: str, scene: str) -> list[str]:
    """The row's last three cells: r, the missing ground, and what is missed or open beside what no file tells."""
    rule = load_rule(rule_name)
    file = GALLERY / mirror
    asked = RuleRequest(str(file) if file.exists() else mirror, rule_name, class_name, str(GALLERY / scene))
    _, measured = measured_mirror(asked, rule, scene_with_eyes(str(GALLERY / scene)))
    of = judged(measured, class_name)
    named = {each.asked.quantity for each in of}
    radius = line(of, "radius_r_mm" if "radius_r_mm" in named else "radius_centre_mm").value
    field = line(of, "field_missing_m2") if "field_missing_m2" in named else None
    told = [f"{each.asked.quantity} {each.verdict}" for each in of if each.verdict != "met" and each.value is not None]
    missing = "–" if field is None else f"{field.value:.2f}"
    return ["flat" if radius is None else f"{radius:.1f}", missing, ", ".join(told) or "–"]


def test_gallery_has_its_cases() -> None:
    assert len(rows()) == 10


def test_papers_first_mirror_is_as_the_gallery_has_it() -> None:
    mirror, rule, name, scene, *told = next(row for row in rows() if row[0] == "progressive-a")
    assert case(mirror, rule, name, scene) == told


@pytest.mark.long
@pytest.mark.parametrize("row", rows(), ids=lambda row: f"{row[0]} {row[1]} {row[2]}")
def test_gallery_is_what_is_measured(row: tuple[str, ...]) -> None:
    assert case(*row[:4]) == list(row[4:])


def test_rule_of_the_page(tmp_path: Path) -> None:
    """The file that the page shows is one, and takes over all else of class II."""
    text = (GALLERY / "README.md").read_text("utf-8").split("larger radius of class II:\n\n")[1]
    own = tmp_path / "own.toml"
    own.write_text("\n".join(row.removeprefix("    ") for row in text.splitlines()), encoding="utf-8")
    rule, base = load_rule(str(own)), load_rule("r46-03")
    assert [each.limit for each in rule.lines_of("II") if each.quantity == "radius_r_mm"] == [(1250.0, float("inf"))]
    assert len(rule.lines_of("II")) == len(base.lines_of("II"))
    assert rule.lines_of("IV")[0].limit == base.lines_of("IV")[0].limit


@pytest.mark.long
@pytest.mark.parametrize("preset", ["progressive-c", "european-aspheric", "sphere-1250"])
def test_all_classes_of_all_rules_of_a_step_file_take_two_seconds(preset: str, tmp_path: Path) -> None:
    """Of the processor, once the kernels are there: the machine is shared."""
    path, scene = tmp_path / f"{preset}.step", scene_with_eyes("motorway")
    design(load_spec(preset)).export_step(path)
    rules = [load_rule(name) for name in ("R46", "GB15084", "FMVSS111", "r46-04")]
    for _ in range(2):
        begun, lines = time.process_time(), 0
        _, measured = measured_mirror(RuleRequest(str(path), "R46", None, "motorway"), rules[0], scene)
        for rule in rules:
            of = measured.by_rule(rule)
            lines += sum(len(judged(of, name)) for name in rule.classes)
        taken = time.process_time() - begun
    assert lines > 150
    assert taken < 2.0


def test_another_rule_measures_the_same_as_by_itself() -> None:
    """What is taken over from the first rule is what the second finds alone, and its own readings are its own."""
    asked, scene = RuleRequest("sphere-1250", "R46", None, "motorway"), scene_with_eyes("motorway")
    _, first = measured_mirror(asked, load_rule("R46"), scene)
    judged(first, "VII"), judged(first, "II")
    for name, kind in (("FMVSS111", "passenger"), ("GB15084", "II")):
        rule = load_rule(name)
        _, alone = measured_mirror(RuleRequest("sphere-1250", name, None, "motorway"), rule, scene)
        shared = [each.as_json() for each in judged(first.by_rule(rule), kind)]
        assert shared == [each.as_json() for each in judged(alone, kind)]
    assert len(first.by_rule(load_rule("FMVSS111")).radii.at) == 5
