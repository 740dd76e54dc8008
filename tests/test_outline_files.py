"""What is true of outline files of either kind: damaged, missing, too large."""

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mirror_cad.errors import OutlineError
from mirror_cad.outline import truck_outline
from mirror_cad.outline.files import read_outline, write_dxf
from tests.outline_helpers import svg

GARBAGE = [
    b"", b"\0", b"garbage", bytes(range(256)) * 40, b"0\nSECTION\n",
    b"  0\nSECTION\n  2\nENTITIES\n  0\nLINE\n 10\nx\n",
    b"AutoCAD Binary DXF\r\n\x1a\0" + bytes(range(256)), b"0\nSECTION\n2\nENTITIES\n0\nARC\n8\n0\n0\nENDSEC\n0\nEOF\n",
    b"<svg", b"<svg xmlns='http://www.w3.org/2000/svg'/>", b"<html/>", b"\xff\xfe<\0s\0",
    b"<?xml version='1.0' encoding='no'?><svg/>",
]  # fmt: skip


@pytest.mark.parametrize("suffix", [".dxf", ".svg", ".DXF", ".Svg"])
@pytest.mark.parametrize("data", GARBAGE)
def test_garbage_is_an_outline_error(tmp_path, data, suffix):
    path = tmp_path / f"garbage{suffix}"
    path.write_bytes(data)
    with pytest.raises(OutlineError, match="garbage"):
        read_outline(path)


@given(st.data())
@settings(deadline=None, max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_damaged_file_is_read_or_is_an_outline_error(tmp_path, data):
    suffix = data.draw(st.sampled_from([".dxf", ".svg"]))
    whole = tmp_path / f"whole{suffix}"
    if not whole.exists():
        if suffix == ".dxf":
            write_dxf(truck_outline(250, 400, 360, 30), whole)
        else:
            whole.write_text(
                '<svg width="9cm" viewBox="0 0 90 90"><path d="M1 1H60A9 8 7 0 1 60 60C5 6 7 8 1 40z"/></svg>'
            )
    raw = bytearray(whole.read_bytes())
    # Damage the entities rather than the many tables before them.
    first = raw.index(b"ENTITIES") if suffix == ".dxf" else 0
    last = raw.index(b"OBJECTS") if suffix == ".dxf" else len(raw)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(first, last - 1))
        raw[at : at + data.draw(st.integers(0, 3))] = data.draw(st.binary(max_size=4))
    path = tmp_path / f"damaged{suffix}"
    path.write_bytes(raw)
    try:
        read_outline(path)
    except OutlineError as error:
        assert "damaged" in str(error)


def test_files_that_are_missing_large_or_of_another_kind_are_errors(tmp_path):
    with pytest.raises(OutlineError, match=r"nothing\.dxf: cannot be read: No such file"):
        read_outline(tmp_path / "nothing.dxf")
    with pytest.raises(OutlineError, match=r"must end in \.dxf or \.svg, not '\.step'"):
        read_outline(tmp_path / "outline.step")
    (tmp_path / "folder.svg").mkdir()
    with pytest.raises(OutlineError, match="not a file"):
        read_outline(tmp_path / "folder.svg")
    large = tmp_path / "large.svg"
    with large.open("wb") as stream:
        stream.truncate(20_000_001)
    with pytest.raises(OutlineError, match="20000001 bytes"):
        read_outline(large)


def test_more_than_20000_segments_are_an_error_and_20000_are_read(tmp_path):
    angle = np.linspace(0, 2 * math.pi, 20_001)
    points = 100 * np.column_stack([np.cos(angle), np.sin(angle)])
    text = " ".join(f"{x!r},{y!r}" for x, y in points[:-1].tolist())
    assert len(read_outline(svg(tmp_path, f'<polygon points="{text}"/>')).segments) == 20_000
    with pytest.raises(OutlineError, match="more than 20000 segments"):
        read_outline(svg(tmp_path, f'<polygon points="{text} 101,-0.01"/>'))
