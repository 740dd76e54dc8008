"""What `trace` leaves: its manifest names only what the trace used."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mirror_cad.design_stages import design
from mirror_studio.cli import run
from tests.conftest import constant, spec_of


def test_a_traces_manifest_holds_what_was_lent_and_no_laws(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    design(spec_of(constant(1250.0), constant(1250.0))).export_step("mirror.step")
    Path("lent.toml").write_text('[horizontal]\nlaw = "constant"\nradius_mm = 900.0\n[vertical]\nlaw = "constant"\n'
                                 "radius_mm = 900.0\n[view]\nwidth_px = 40\n")
    assert run(["trace", "mirror.step", "--scene", "lent.toml", "--out", "set"]) == 0
    manifest = json.loads(Path("set/manifest.json").read_text())
    assert set(manifest["spec"]) == {"eye", "scene", "view"}
    assert manifest["spec"]["view"] == {"width_px": 40}
