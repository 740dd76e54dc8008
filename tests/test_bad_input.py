"""Bad input: exit code 2, one message a fault that names file, key, value and what to do, and nothing written."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import pytest

import mirror_cad
from mirror_studio.cli import BAD_INPUT, run
from tests.conftest import constant, spec_of

VERTICAL = '[vertical]\nlaw = "constant"\nradius_mm = 1250.0\n'
HORIZONTAL = '[horizontal]\nlaw = "constant"\nradius_mm = 1250.0\n'
TABLE = '[horizontal]\nlaw = "table"\n'
ZONES = '[horizontal]\nlaw = "zones"\nright_mm = 1250.0\nleft_mm = 400.0\nblend_from = 0.5\n'
MATCH = ZONES.replace("0.5", '"match"') + "[horizontal.match]\n"

# What is wrong: the specification's text, and what the message must name.
CASES = {
    "unknown key": (ZONES + "blend_form = 0.5\n" + VERTICAL, ["horizontal.blend_form", "did you mean 'blend_from'"]),
    "unknown section": (HORIZONTAL + VERTICAL + "[outlin]\n", ["outlin", "did you mean 'outline'"]),
    "missing key": ('[horizontal]\nlaw = "constant"\n' + VERTICAL, ["horizontal.radius_mm", "required"]),
    "missing section": (HORIZONTAL, ["vertical", "required"]),
    "another law's key": (HORIZONTAL + "exponent = 2.0\n" + VERTICAL, ["horizontal.exponent", "law = 'power'"]),
    "string for number": (HORIZONTAL + VERTICAL + '[glass]\nthickness_mm = "3"\n', ["glass.thickness_mm", '"3"', "number"]),
    "boolean for number": (HORIZONTAL + VERTICAL + "[glass]\nthickness_mm = true\n", ["glass.thickness_mm", "number"]),
    "nan": (HORIZONTAL.replace("1250.0", "nan") + VERTICAL, ["horizontal.radius_mm = nan"]),
    "inf where meaningless": (HORIZONTAL + VERTICAL + "[eye]\ndistance_mm = inf\n", ["eye.distance_mm = inf", "finite"]),
    "inf radius in zones": (ZONES.replace("400.0", "inf") + VERTICAL, ["horizontal.left_mm = inf", "curvature"]),
    "zero radius": (HORIZONTAL.replace("1250.0", "0") + VERTICAL, ["horizontal.radius_mm = 0", "other than 0"]),
    "opposite signs": ('[horizontal]\nlaw = "linear"\nright_mm = 900.0\nleft_mm = -900.0\n' + VERTICAL,
                       ["right_mm = 900", "left_mm = -900", "as curvature"]),
    "wider than the blank": (HORIZONTAL + VERTICAL + "[outline]\nwidth_mm = 260.0\n", ["outline.width_mm = 260", "250"]),
    "half-height above Ry": (HORIZONTAL + VERTICAL.replace("1250", "150"), ["150.0 mm", "half-height", "163."]),
    "profile turns vertical": (HORIZONTAL.replace("1250", "105") + VERTICAL, ["turns vertical at x = ", "of -115.0 mm"]),
    "match without a solution": (MATCH + "h_fov_deg = 120.0\n" + VERTICAL, ["120.00°", "reaches"]),
    "match by a small sphere": (MATCH + "sphere_mm = 100.0\n" + VERTICAL, ["sphere_mm = 100", "115"]),
    "empty table": (TABLE + "x_mm = []\nradius_mm = []\n" + VERTICAL, ["0", "rows"]),
    "one-row table": (TABLE + "x_mm = [0.0]\nradius_mm = [900.0]\n" + VERTICAL, ["1", "rows"]),
    "unsorted table": (TABLE + "x_mm = [0.0, 5.0, 3.0]\nradius_mm = [900.0, 900.0, 800.0]\n" + VERTICAL,
                       ["must rise", "row 3 has 3 after 5"]),
    "columns of different length": (TABLE + "x_mm = [0.0, 5.0]\nradius_mm = [900.0]\n" + VERTICAL, ["2 rows", "1"]),
    "call in a formula": ('[horizontal]\nlaw = "expression"\nradius = "__import__(\'os\').system(\'touch x\')"\n' + VERTICAL,
                          ["a call to", "__import__"]),
    "attribute in a formula": ('[horizontal]\nlaw = "expression"\nradius = "t.__class__"\n' + VERTICAL, ["t.__class__"]),
    "formula with a pole": ('[horizontal]\nlaw = "expression"\ncurvature = "0.001/(x - 20.0)"\n' + VERTICAL,
                            ["per mm at x = 2", "radius below 1 mm"]),
    "formula of a root of the negative": ('[horizontal]\nlaw = "expression"\ncurvature = "0.001*sqrt(x)"\n' + VERTICAL,
                                          ["not finite", "x = "]),
    "name with a path": ('name = "../../evil"\n' + HORIZONTAL + VERTICAL, ["name", "../../evil", "no path"]),
    "no such picture": (HORIZONTAL + VERTICAL + '[scene]\nimage = "nowhere.png"\n', ["nowhere.png", "no such picture"]),
    "eye in the mirror": (HORIZONTAL + VERTICAL + "[eye]\ndistance_mm = 100.0\n", ["distance_mm = 100", "115"]),
    "TOML syntax error": ("[horizontal\nlaw = 3", ["not TOML", "line 1"]),
    "no such outline": (HORIZONTAL + VERTICAL + '[outline]\nfile = "nowhere.dxf"\n', ["nowhere.dxf"]),
    "corner arcs that do not fit": (HORIZONTAL + VERTICAL + "[outline]\ncorner_radius_mm = 150.0\n", ["150", "corner"]),
    "step for quadrature": (HORIZONTAL + VERTICAL + "[surface]\nstep_mm = 1.0\n", ["step_mm", "euler"]),
    "Euler without a step": (HORIZONTAL + VERTICAL + '[surface]\nintegration = "euler"\n', ["step_mm"]),
}


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")


def refused(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """Run a command that must be refused; returns its message."""
    before = set(Path.cwd().rglob("*"))
    assert run(arguments) == BAD_INPUT
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "Traceback" not in captured.err
    assert set(Path.cwd().rglob("*")) == before
    return captured.err


@pytest.mark.parametrize("case", CASES)
def test_bad_specifications_are_refused(case: str, spec_file: Callable[[str], Path],
                                        capsys: pytest.CaptureFixture[str]) -> None:
    text, named = CASES[case]
    message = refused(["build", str(spec_file(text))], capsys)
    for part in named:
        assert part in message
    assert message.splitlines()[-1].startswith("mirror-cad: ")


def test_all_faults_are_reported_at_once(spec_file: Callable[[str], Path], capsys: pytest.CaptureFixture[str]) -> None:
    text = ZONES.replace("1250.0", '"x"') + "blend = 3\n" + VERTICAL + "[glass]\nthickness_mm = -1\n[eye]\nalinged = 1\n"
    message = refused(["build", str(spec_file(text))], capsys)
    for key in ("horizontal.right_mm", "horizontal.blend", "glass.thickness_mm", "eye.alinged"):
        assert sum(key in line for line in message.splitlines()) >= 1
    assert all(line.startswith("mirror-cad: ") for line in message.splitlines())


def test_binary_and_missing_specifications(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "binary.toml").write_bytes(bytes(range(256)) * 20)
    assert "not a text file" in refused(["build", str(tmp_path / "binary.toml")], capsys)
    assert "did you mean the preset 'progressive-c'" in refused(["build", "progresive-c"], capsys)
    refused(["build", str(tmp_path)], capsys)


def test_unknown_command_and_option_name_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    assert "build" in refused(["biuld", "x"], capsys)
    assert "--out" in refused(["build", "progressive-c", "--ouy", "x"], capsys)


def test_a_part_of_the_benchmark_needs_its_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["bench", "--part"]) == BAD_INPUT
    assert "--part" in capsys.readouterr().err


def test_a_law_beside_the_mirror_is_noted() -> None:
    table = {"law": "table", "x_mm": [1.0, 2.0], "radius_mm": [900.0, 800.0]}
    metres = mirror_cad.design(spec_of(table | {"x_mm": [200.0, 300.0]}, constant(900.0)))
    assert any("beside the mirror" in note for note in metres.notes)
    inside = mirror_cad.design(spec_of(table, constant(900.0)))
    assert not any("beside the mirror" in note for note in inside.notes)


def test_picture_of_forty_thousand_by_forty_thousand_is_refused_before_decoding(
        tmp_path: Path, spec_file: Callable[[str], Path], capsys: pytest.CaptureFixture[str]) -> None:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", 40_000, 40_000, 8, 2, 0, 0, 0)
    (tmp_path / "huge.png").write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(b"\0"))
                                        + chunk(b"IEND", b""))
    path = spec_file(HORIZONTAL + VERTICAL + '[scene]\nimage = "huge.png"\n')
    assert "too many" in refused(["build", str(path)], capsys)
    (tmp_path / "huge.png").write_bytes(b"GIF87a no picture at all")
    assert "huge.png" in refused(["build", str(path)], capsys)


DXF_HEAD = "0\nSECTION\n2\nENTITIES\n"
DXF_TAIL = "0\nENDSEC\n0\nEOF\n"


def dxf_lines(*loops: list[tuple[float, float]], closed: bool = True) -> str:
    entities = ""
    for loop in loops:
        ends = loop[1:] + (loop[:1] if closed else [])
        for (x0, y0), (x1, y1) in zip(loop, ends, strict=False):
            entities += f"0\nLINE\n8\n0\n10\n{x0}\n20\n{y0}\n11\n{x1}\n21\n{y1}\n"
    return DXF_HEAD + entities + DXF_TAIL


SQUARE = [(-50.0, -50.0), (50.0, -50.0), (50.0, 50.0), (-50.0, 50.0)]


@pytest.mark.parametrize(("text", "named"), [
    (dxf_lines(SQUARE, closed=False), "gap"),
    (dxf_lines(SQUARE, [(x / 5, y / 5) for x, y in SQUARE]), "2"),
    (dxf_lines([(x + 500, y) for x, y in SQUARE]), "blank"),
    (dxf_lines([(x + 60, y) for x, y in SQUARE]), "origin"),
    ("no DXF at all", "outline.dxf"),
], ids=["open outline", "two loops", "beyond the blank", "without the origin", "garbage"])
def test_bad_outlines_are_refused(text: str, named: str, tmp_path: Path, spec_file: Callable[[str], Path],
                                  capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "outline.dxf").write_text(text)
    assert named in refused(["build", str(spec_file(HORIZONTAL + VERTICAL + '[outline]\nfile = "outline.dxf"\n'))], capsys)


@pytest.mark.skipif(os.geteuid() == 0 and not Path("/proc/self").exists(), reason="root may write anywhere but in /proc")
def test_folders_that_cannot_be_written_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "--out" in refused(["build", "sphere-950", "--out", "/proc/mirror"], capsys)
    (tmp_path / "file").write_text("")
    assert "this is a file" in refused(["build", "sphere-950", "--out", str(tmp_path / "file")], capsys)
    assert "current folder" in refused(["build", "sphere-950", "--out", "."], capsys)


def test_bad_reflector_files_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "bad.step").write_text("ISO-10303-21; nonsense")
    (tmp_path / "bad.stl").write_bytes(b"solid nothing\nendsolid nothing\n")
    (tmp_path / "mirror.obj").write_text("v 0 0 0")
    for name in ("bad.step", "bad.stl", "mirror.obj", "missing.step"):
        assert name in refused(["trace", str(tmp_path / name)], capsys)


def test_missed_limit_is_exit_code_3_with_the_files_written(spec_file: Callable[[str], Path],
                                                            capsys: pytest.CaptureFixture[str]) -> None:
    text = HORIZONTAL + VERTICAL + ("[limits]\ncurvature_percent = 0.5\n[view]\nwidth_px = 32\n[outline]\nwidth_mm = 200\n"
                                    "left_height_mm = 300\nright_height_mm = 300\n")
    assert run(["build", str(spec_file(text)), "--out", "set"]) == 3
    assert "the limit is 0.5 %" in capsys.readouterr().err
    assert (Path("set") / "spec.step").is_file()
