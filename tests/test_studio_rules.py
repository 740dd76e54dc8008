"""The studio's panel of a rule of the road: what it offers and refuses, its lines, and how it turns with the design."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import expect

from mirror_cad.errors import SpecError
from mirror_cad.spec.file import load_spec
from mirror_cad.spec.rules_section import RulesSection
from mirror_studio.rules.schema import load_rule
from mirror_studio.web import engine, state
from mirror_studio.web.protocol import ViewSettings
from mirror_studio.web.rules import offered, ruled
from mirror_studio.web.uploads import Uploads
from tests.studio_page import CHROMIUM, SOON, chromium, opened, settled
from tests.studio_server import running
from tests.test_studio_wire import answer, design, wire


@pytest.fixture(scope="module")
def uploads() -> Iterator[Uploads]:
    kept = Uploads()
    yield kept
    kept.close()


def lines_of(preset: str, view: str = "picture", fine: bool = True, **rules: Any) -> dict[str, Any]:
    spec = load_spec(preset).model_copy(update={"rules": RulesSection.model_validate(rules)})
    return ruled(engine.designed(spec), ViewSettings(view=view), fine)  # type: ignore[arg-type]


def row(found: dict[str, Any], quantity: str) -> dict[str, Any]:
    (one,) = (line for line in found["lines"] if line["quantity"] == quantity)
    return one


def test_it_offers_what_there_is() -> None:
    for one in offered():
        rule = load_rule(str(one["name"]))
        assert one["classes"] == list(rule.classes)
        assert one["start"] == rule.default_class


def test_lines_of_a_sphere() -> None:
    found = lines_of("sphere-1250", rule="R46", **{"class": "II"})
    assert (found["rule"], found["class"], found["vehicle"]) == ("R46", "II", False)
    radius = row(found, "radius_r_mm")
    assert (radius["value"], radius["limit"], radius["margin"], radius["verdict"]) == ("1250.00", "≥ 1200", "+50.00", "met")
    assert not [line for line in found["lines"] if line["quantity"].startswith(("field_", "mirror_"))]
    assert "complies" not in json.dumps(found)


def test_fields_come_on_the_road_when_the_hand_rests() -> None:
    draft = lines_of("sphere-1250", "road", fine=False, rule="R46", **{"class": "II"})
    assert (draft["pending"], draft["vehicle"]) == (True, False)
    found = lines_of("sphere-1250", "road", rule="R46", **{"class": "II"})
    assert (found["pending"], found["vehicle"]) == (False, True)
    assert row(found, "field_missing_m2")["verdict"] == "met"


def test_design_that_names_no_rule_has_no_lines() -> None:
    assert ruled(engine.designed(load_spec("flat")), ViewSettings(), True) == {"lines": []}


@pytest.mark.parametrize("rule", ["/etc/passwd", "own.toml", "../r46-03", 3])
def test_no_rule_file_is_read_by_its_name(rule: Any, uploads: Uploads) -> None:
    held = state.as_state(load_spec("progressive-c")) | {"rules": {"rule": rule}}
    with pytest.raises(SpecError, match=r"rules.rule = .*the studio knows R46, GB15084, FMVSS111, r46-04"):
        state.as_spec(held, uploads)


def test_rule_goes_to_toml_and_comes_back(uploads: Uploads) -> None:
    held = state.as_state(load_spec("progressive-c")) | {"rules": {"rule": "R46", "class": "IV"}}
    text = state.as_toml(state.as_spec(held, uploads))
    assert '[rules]\nrule = "R46"\nclass = "IV"' in text
    assert state.read_toml(text, uploads)[0]["rules"] == {"rule": "R46", "class": "IV"}


def test_lines_are_those_of_the_design_shown_last() -> None:
    with running() as studio, wire(studio) as connection:
        connection.send(json.dumps({"type": "rules", "id": 1}))
        assert answer(connection) == {"id": 1, "type": "ruled", "lines": []}
        for number, radius in ((2, 1199.0), (3, 1201.0)):
            spec = state.as_state(load_spec("sphere-950")) | {"rules": {"rule": "R46", "class": "II"}}
            for axis in ("horizontal", "vertical"):
                spec[axis] = {"law": "constant", "radius_mm": radius}
            connection.send(design(number, spec))
            assert answer(connection)["type"] == "shown"
            connection.send(json.dumps({"type": "rules", "id": 10 + number, "fine": True}))
            assert row(answer(connection), "radius_r_mm")["verdict"] == ("missed" if radius < 1200.0 else "met")
        spec["rules"]["class"] = "VIII"
        connection.send(design(4, spec))
        assert answer(connection)["type"] == "shown"
        connection.send(json.dumps({"type": "rules", "id": 20}))
        said = answer(connection)
        assert said["type"] == "unruled"
        assert "rules.class = VIII: R46 has no such class" in said["faults"][0]


@pytest.mark.skipif(not CHROMIUM.exists(), reason=f"no Chromium at {CHROMIUM}: the page cannot be opened")
def test_panel_turns_with_the_design() -> None:
    with running() as studio, chromium() as browser, opened(browser, studio, "#progressive-a") as page:
        settled(page)
        page.get_by_role("button", name="Rules").click()
        radius = page.locator("#rule-panel tr[data-quantity=radius_r_mm]")
        expect(radius).to_have_attribute("data-verdict", "missed", timeout=SOON)  # 1175 mm, of class III's 1200
        expect(radius).to_contain_text("−24.7")
        page.locator('input[type=number][aria-label="Rx right in mm"]').fill("1350")
        expect(radius).to_have_attribute("data-verdict", "met", timeout=SOON)
        page.get_by_label("Class of mirror").select_option("IV")
        expect(page.locator("#rule-panel")).to_contain_text("≥ 300", timeout=SOON)
        page.wait_for_function("() => location.hash.includes('rules.class=IV')", timeout=SOON)
        page.get_by_label("Reflectance as measured, %").fill("39")
        expect(page.locator("#rule-panel tr[data-quantity=reflectance_percent]")).to_have_attribute(
            "data-verdict", "missed", timeout=SOON)
        page.get_by_role("button", name="Rules").click()
        expect(page.locator("#mirror-3d")).to_be_visible()
