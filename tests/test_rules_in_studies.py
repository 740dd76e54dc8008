"""Lines of a rule as figures of a study: their values, what is refused, and an optimum that lies on one of them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mirror_cad.errors import SpecError
from mirror_cad.spec.file import load_spec, spec_as_json
from mirror_studio.explore.evaluate import evaluate
from mirror_studio.explore.optimise import optimise
from mirror_studio.explore.study import load_study
from mirror_studio.progress import Progress

STUDY = '''spec = "design.toml"
measures = ["radius_r_mm", "radius_r_mm_margin"]
[vary]
"horizontal.radius_mm" = { from = 1000.0, to = 1300.0, count = 3 }
'''
DESIGN = '''[horizontal]
law = "constant"
radius_mm = 1200.0
[vertical]
law = "constant"
radius_mm = 1300.0
[outline]
width_mm = 120.0
left_height_mm = 120.0
right_height_mm = 120.0
'''
RULES = '[rules]\nrule = "R46"\nclass = "II"\n'


def raw(preset: str, **rules: str) -> dict[str, Any]:
    return spec_as_json(load_spec(preset)) | {"rules": rules}


def written(folder: Path, study: str, design: str = DESIGN + RULES) -> Path:
    (folder / "design.toml").write_text(design, encoding="utf-8")
    (folder / "study.toml").write_text(study, encoding="utf-8")
    return folder / "study.toml"


def test_row_of_a_sphere() -> None:
    names = ("radius_r_mm", "radius_r_mm_margin", "radius_ri_spread_percent_margin", "rule_lines_missed", "segment_b_mm")
    row = evaluate(0, (), raw("sphere-1250", rule="R46", **{"class": "II"}), ".", None, names)
    assert row.cause == ""
    assert row.figures == pytest.approx((1250.0, 50.0, 15.0, 0.0, 326.905), abs=1e-3)


def test_row_on_a_vehicle_has_fields() -> None:
    names = ("field_missing_m2", "field_missing_m2_margin", "rule_lines_missed", "h_fov_section_deg")
    row = evaluate(0, (), raw("sphere-1250", rule="R46", **{"class": "II"}), ".", "motorway", names)
    assert row.figures[:3] == (0.0, 0.0, 0.0)
    assert row.figures[3] is not None


def test_what_a_rule_does_not_ask_is_none() -> None:
    """Class IV has no rectangle, and the ten readings of FMVSS no r_p."""
    for rule, name, figure in (("R46", "IV", "rectangle_mm"), ("FMVSS111", "passenger", "radius_rp_spread_percent")):
        row = evaluate(0, (), raw("sphere-1250", rule=rule, **{"class": name}), ".", None, (figure,))
        assert (row.status, row.figures) == ("ok", (None,))


def test_class_that_the_rule_has_not_is_the_rows_cause() -> None:
    row = evaluate(0, (), raw("sphere-1250", rule="R46", **{"class": "VIII"}), ".", None, ("radius_r_mm",))
    assert row.status == "failed"
    assert row.cause.startswith("rules.class = VIII: R46 has no such class")


@pytest.mark.parametrize(("study", "design", "said"), [
    (STUDY, DESIGN, "radius_r_mm is a line of a rule: give the specification [rules] with rule and class"),
    (STUDY.replace('"radius_r_mm", ', '"field_missing_m2", '), DESIGN + RULES,
     "field_missing_m2 is asked of a mirror on its vehicle: give scene"),
    (STUDY.replace('"radius_r_mm", ', '"radius_mm", '), DESIGN + RULES,
     "unknown measure 'radius_mm'; did you mean 'radius_r_mm'?")])
def test_refused(study: str, design: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(SpecError) as caught:
        load_study(written(tmp_path, study, design))
    assert said in str(caught.value)


def test_rule_may_be_varied(tmp_path: Path) -> None:
    study = load_study(written(tmp_path, STUDY + '"rules.class" = { values = ["I", "II"] }\n'))
    assert study.with_values(study.designs()[1])["rules"] == {"rule": "R46", "class": "II"}


@pytest.mark.long
def test_optimum_lies_on_the_rules_line(tmp_path: Path, spec_file: Callable[..., Path]) -> None:
    """The smallest horizontal radius whose mean with 1300 mm upright is no less than 1200: about 1100."""
    study = load_study(written(tmp_path, '''spec = "design.toml"
[vary]
"horizontal.radius_mm" = { from = 1000.0, to = 1300.0 }
[optimise]
minimise = ["radius_r_mm"]
population = 4
generations = 8
[optimise.limits]
radius_r_mm_margin = [0.0, inf]
'''), optimise=True)
    found = optimise(study, tmp_path / "out", Progress())
    assert found.active == ("radius_r_mm_margin",)
    assert found.front[0].figures[0] == pytest.approx(1200.0, abs=1.0)
