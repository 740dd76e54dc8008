"""The README is the truth: its Python runs, its presets exist, its test command is what CI calls."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import mirror_cad
from mirror_cad.spec.file import validate_spec

HOME = Path(__file__).resolve().parent.parent
README = (HOME / "README.md").read_text("utf-8")


def block(language: str) -> str:
    found = re.search(rf"```{language}\n(.*?)```", README, re.DOTALL)
    assert found is not None
    return found.group(1)


def test_the_ten_lines_of_python_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                     capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    exec(compile(block("python"), "README.md", "exec"), {})
    assert len(capsys.readouterr().out.splitlines()) >= 3
    assert (tmp_path / "mirror.step").is_file()


def test_the_specification_is_the_preset() -> None:
    import tomllib

    spec = validate_spec(tomllib.loads(block("toml")))
    preset = mirror_cad.load_spec("progressive-c")
    assert spec.horizontal == preset.horizontal
    assert spec.vertical == preset.vertical


def test_every_preset_is_named_and_every_named_file_exists() -> None:
    for name in mirror_cad.preset_names():
        assert name in README or f"`{name[-2:]}`" in README
    for path in re.findall(r"\]\(([^)]+)\)", README) + re.findall(r"`(docs/[^`]+|benchmarks/[^`]+)`", README):
        assert (HOME / path).exists(), path


def test_ci_calls_the_readme_test_command() -> None:
    script = (HOME / ".ci" / "run").read_text("utf-8")
    assert "README.md" in script
    after = README.split("<!-- test command -->")[1]
    assert re.search(r"^ *python3\.11 run\.py test$", after, re.MULTILINE)
