"""Damaged outline files, tables and specifications: read, or refused with a message; no traceback, no hang, no half a set."""

from __future__ import annotations

import math
import os
import random
import re
import signal
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import mirror_cad
from mirror_cad.design_stages import design
from mirror_cad.outline import truck_outline
from mirror_cad.outline.files import write_dxf
from mirror_cad.spec import MirrorSpec
from mirror_studio.build import pipeline
from mirror_studio.build.results import Metrics
from mirror_studio.cli import run
from mirror_studio.progress import Progress

CASES = Path(__file__).parent / "cases"
SECONDS = 60  # after which a file counts as one that hangs
NUMBER = re.compile(rb"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")
NUMBERS = (b"0", b"-1", b"1e308", b"-1e308", b"1e-320", b"nan", b"inf", b"-inf", b"1e5", b"0.05", b"9" * 400, b"", b"x", b"1,5")
SVG = """<?xml version="1.0"?><svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" width="250mm"
 height="380mm" viewBox="-125 -190 250 380"><style>.a{clip-path:url(#board);}</style><defs><clipPath id="board">
<rect x="-125" y="-190" width="250" height="380"/></clipPath><path id="rim" d="M-100 -120H80A20 20 0 0 1 100 -100V90
C100 110 90 120 70 120L-80 120Q-100 120 -100 100Z"/></defs><switch><g class="a" transform="translate(3,-2) rotate(4)">
<use xlink:href="#rim"/></g></switch></svg>"""
HEAD = 'name = "m"\n[view]\nwidth_px = 16\n[export]\nstl_deflection_mm = 1.0\n'
CONSTANT = '[{0}]\nlaw = "constant"\nradius_mm = 1250.0\n'


def whole_files(folder: Path) -> dict[str, tuple[str, bytes]]:
    """For each kind of file the specification that uses it, and its undamaged bytes."""
    write_dxf(truck_outline(200, 260, 300, 30), folder / "rim.dxf")
    x = np.linspace(-115.0, 115.0, 24)
    rows = "".join(f"{a:.3f},{1250.0 - 600.0 * ((115.0 - a) / 230.0) ** 2:.6f}\n" for a in x)
    table = CONSTANT.format("vertical") + '[horizontal]\nlaw = "table"\nfile = "damaged.csv"\n'
    outline = (HEAD + CONSTANT.format("horizontal") + CONSTANT.format("vertical")
               + '[outline]\nfile = "damaged.{0}"\nloop = "outermost"\n')
    preset = (Path(mirror_cad.__file__).parent / "designs" / "progressive-c.toml").read_text()
    return {"dxf": (outline.format("dxf"), (folder / "rim.dxf").read_bytes()),
            "small.dxf": (outline.format("small.dxf"), (CASES / "dxf-hidden-layers" / "outline.dxf").read_bytes()),
            "svg": (outline.format("svg"), SVG.encode()),
            "csv": (HEAD + table, b"x_mm,radius_mm\n" + rows.encode()),
            "toml": ("", preset.encode())}


def damaged(data: bytes, rng: random.Random) -> bytes:
    """The bytes with one to four changes, as a bad line, a bad disk, an editor or a hand makes them."""
    found = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(max(1, len(found)))
        end = min(len(found), at + rng.randint(0, 40))
        kind = rng.randrange(8)
        if kind == 0:
            found[at:at + 1] = bytes([rng.randrange(256)])
        elif kind == 1:
            del found[at:end]
        elif kind == 2:
            found[at:at] = found[at:end] * rng.randint(1, 3)
        elif kind == 3 and rng.random() < 0.3:
            del found[at:]
        elif kind == 4:
            found[at:at] = bytes(rng.randrange(256) for _ in range(rng.randint(1, 6)))
        elif kind == 5:
            lines = bytes(found).split(b"\n")
            i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
            lines[i], lines[j] = lines[j], lines[i]
            found = bytearray(b"\n".join(lines))
        else:
            numbers = list(NUMBER.finditer(bytes(found)))
            if numbers:
                here = rng.choice(numbers)
                found[here.start():here.end()] = rng.choice(NUMBERS)
    return bytes(found)


@contextmanager
def within(seconds: int) -> Iterator[None]:
    def late(*_: object) -> None:
        raise AssertionError(f"not done within {seconds} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def designed_only(folder: Path, spec: MirrorSpec, progress: Progress, pdf: bool = False) -> pipeline.Built:
    """All that reads the files: what comes after sees a mirror that is as good as any."""
    pipeline.load_picture(spec.scene.image)
    mirror = design(spec)
    write_dxf(mirror.outline, folder / "outline.dxf")
    assert math.isfinite(mirror.outline.area_mm2())
    assert np.isfinite(mirror.surface.poles).all()
    return pipeline.Built(mirror, None, Metrics(), ())  # type: ignore[arg-type]


def check(kind: str, seed: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text, data = whole_files(tmp_path)[kind]
    name = f"damaged.{kind}"
    (tmp_path / name).write_bytes(damaged(data, random.Random(f"{kind} {seed}")))
    if text:
        (tmp_path / "spec.toml").write_text(text)
    before = sorted(os.listdir(tmp_path))
    with within(SECONDS), warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        code = run(["build", str(tmp_path / ("spec.toml" if text else name)), "--out", str(tmp_path / "set")])
    said = capsys.readouterr().err
    assert code in (0, 2, 3), said
    assert "Traceback" not in said
    if code == 2:
        assert any(line.startswith("mirror-cad: ") and len(line) > 20 for line in said.splitlines()), said
        assert sorted(os.listdir(tmp_path)) == before
    else:
        assert (tmp_path / "set" / "outline.dxf").is_file()


KINDS = ("dxf", "small.dxf", "svg", "csv", "toml")


@pytest.mark.parametrize("kind", KINDS)
def test_the_whole_files_are_read(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pipeline, "build_into", designed_only)
    text, data = whole_files(tmp_path)[kind]
    (tmp_path / f"damaged.{kind}").write_bytes(data)
    (tmp_path / "spec.toml").write_text(text)
    assert run(["build", str(tmp_path / ("spec.toml" if text else f"damaged.{kind}")), "--out", str(tmp_path / "set")]) == 0


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_file_is_read_or_refused_with_a_message(kind: str, seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                                          capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(pipeline, "build_into", designed_only)
    check(kind, seed, tmp_path, capsys)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(100, 180))
@pytest.mark.parametrize("kind", KINDS)
def test_many_damaged_files_are_read_or_refused(kind: str, seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                                capsys: pytest.CaptureFixture[str]) -> None:
    """Each tenth is built to its end."""
    if seed % 10:
        monkeypatch.setattr(pipeline, "build_into", designed_only)
    check(kind, seed, tmp_path, capsys)


def test_a_fault_of_our_own_would_be_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                          capsys: pytest.CaptureFixture[str]) -> None:
    def failing(*_: object) -> pipeline.Built:
        raise KeyError("not a message")

    monkeypatch.setattr(pipeline, "build_into", failing)
    monkeypatch.setattr("tests.test_fuzz_texts.damaged", lambda data, rng: data)
    with pytest.raises(AssertionError, match="internal error"):
        check("csv", 0, tmp_path, capsys)


