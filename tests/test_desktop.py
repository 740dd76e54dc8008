"""`mirror-cad view`: what its files for ParaView hold, and what it says where no window can be opened."""

from __future__ import annotations

import ctypes.util
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import pyvista

from mirror_cad.deviation import against_design
from mirror_cad.surfaces.differential import normals, principal_curvatures
from mirror_studio.cli import run
from mirror_studio.desktop.sheet import sheet
from mirror_studio.desktop.window import colour_range, round_step
from tests.conftest import designed

FIELDS = {"Rx", "Ry", "k1", "k2", "Ka", "deviation", "normals"}


def command(*arguments: object, environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "mirror_studio", "view", *map(str, arguments)], capture_output=True, text=True,
                          timeout=240, env=environment)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files of progressive-c and its picture, made where no display is."""
    folder = tmp_path_factory.mktemp("view") / "set"
    environment = {key: value for key, value in os.environ.items() if key != "DISPLAY"}
    result = command("progressive-c", "--out", folder, "--png", environment=environment)
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")
    return folder


def test_mirror_file_has_the_surfaces_own_curvatures_and_normals_at_its_points(written: Path) -> None:
    mesh, mirror = pyvista.read(written / "mirror.vtp"), designed("progressive-c")
    assert set(mesh.point_data.keys()) >= FIELDS
    x, y = mesh.points[:, 0].astype(float), mesh.points[:, 1].astype(float)
    u_min, u_max, v_min, v_max = mirror.surface.domain
    d = mirror.surface.derivatives(np.clip(x, u_min, u_max), np.clip(y, v_min, v_max))
    # Points are held in float64: the file's nodes lie on the surface but for rounding.
    assert np.abs(mesh.points - d["s"]).max() < 1e-9
    assert np.abs(mesh.point_data["normals"] - normals(d["u"], d["v"])).max() < 1e-12
    k = 1e3 * principal_curvatures(mirror.surface, x, y)
    assert np.abs(np.stack([mesh.point_data["k1"], mesh.point_data["k2"]], axis=1) - k).max() < 1e-9
    # Euler: kx + ky = k1 + k2 for any two directions at right angles; Ka is half their difference.
    kx, ky = 1e3 / mesh.point_data["Rx"], 1e3 / mesh.point_data["Ry"]
    assert np.abs(kx + ky - k.sum(axis=1)).max() < 1e-9
    assert np.abs(0.5 * (kx - ky) - mesh.point_data["Ka"]).max() < 1e-9
    assert "Rx: mm" in list(mesh.field_data["units"])


def test_mirror_file_covers_the_outline_and_looks_at_the_driver(written: Path) -> None:
    mesh, mirror = pyvista.read(written / "mirror.vtp"), designed("progressive-c")
    # Facets of 2.7 mm on radii from 400 mm, corner arcs of 40 mm in chords of it: some 1e-5 of the area is missing.
    assert mesh.area == pytest.approx(mirror.plate.area_mm2, rel=2e-4)
    corners = mesh.points[mesh.regular_faces]
    assert (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0.0).all()
    total = against_design(mirror.curvature, mirror.outline, mirror.exact, mirror.surface)
    for key in ("k1", "k2"):
        values = mesh.point_data[f"deviation_{key}"]
        # The largest lie on the edge, at whose nodes the sheet looks only every 2.7 mm.
        assert values[np.argmax(np.abs(values))] == pytest.approx(total.of(key).max_percent, rel=5e-3)
    assert mesh.point_data["deviation"].max() == pytest.approx(total.shape.max_percent, rel=5e-3)


def test_rays_leave_the_mirror_at_the_angle_at_which_they_came_and_end_on_the_plane(written: Path) -> None:
    rays, mirror = pyvista.read(written / "rays.vtp"), designed("progressive-c")
    eye, points, ends = rays.points.reshape(-1, 3, 3).astype(float).transpose(1, 0, 2)
    assert len(points) == rays.n_cells > 50
    assert np.ptp(eye, axis=0).max() == 0.0
    assert np.linalg.norm(eye[0]) == pytest.approx(762.0, abs=1e-9)
    d = mirror.surface.derivatives(points[:, 0], points[:, 1])
    normal = normals(d["u"], d["v"])
    assert np.abs(points - d["s"]).max() < 1e-9
    coming, going = eye - points, ends - points
    cosines = [np.einsum("ij,ij->i", way, normal) / np.linalg.norm(way, axis=1) for way in (coming, going)]
    assert np.abs(cosines[0] - cosines[1]).max() < 1e-12
    assert np.abs(np.degrees(np.arccos(cosines[0])) - rays.cell_data["incidence_deg"]).max() < 1e-9
    assert np.abs(ends[:, 2] - (eye[0, 2] + 8200.0)).max() < 1e-8


def test_a_step_file_is_seen_as_the_design_it_came_from_and_a_sphere_has_its_radius(tmp_path: Path) -> None:
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeCylinder, BRepPrimAPI_MakeSphere
    from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt
    from OCP.STEPControl import STEPControl_AsIs, STEPControl_Writer

    mirror = designed("sphere-950")
    mirror.export_step(tmp_path / "mirror.step")
    assert run(["view", str(tmp_path / "mirror.step"), "--vtp", str(tmp_path / "set")]) == 0
    mesh = pyvista.read(tmp_path / "set" / "mirror.vtp")
    assert "deviation" not in mesh.point_data
    assert mesh.area == pytest.approx(mirror.plate.area_mm2, rel=2e-4)
    k = 1e3 * principal_curvatures(mirror.surface, mesh.points[:, 0], mesh.points[:, 1])
    assert np.abs(mesh.point_data["k1"] - k[:, 0]).max() < 1e-8  # STEP moves poles by 5e-13 mm: 7e-9 % of curvature
    assert len(json.loads((tmp_path / "set" / "manifest.json").read_text())["files"]) == 2

    # A cap about a sphere's pole, convex towards the driver; and a cylinder about x.
    cap = BRepPrimAPI_MakeSphere(gp_Ax2(gp_Pnt(0, 0, -500), gp_Dir(0, 0, 1)), 500.0, np.radians(75.0), np.radians(90.0)).Face()
    axes = gp_Ax2(gp_Pnt(-60, 0, -500), gp_Dir(1, 0, 0), gp_Dir(0, 1, 5))
    tube = BRepPrimAPI_MakeCylinder(axes, 500.0, 120.0, np.radians(20.0)).Face()
    for name, face, radii, area in (("cap", cap, (500.0, 500.0), 2e6 * np.pi * 0.25 * (1.0 - np.sin(np.radians(75.0)))),
                                    ("tube", tube, (np.nan, 500.0), 500.0 * 120.0 * np.radians(20.0))):
        writer = STEPControl_Writer()
        writer.Transfer(face, STEPControl_AsIs)
        writer.Write(str(tmp_path / f"{name}.stp"))
        assert run(["view", str(tmp_path / f"{name}.stp"), "--vtp", str(tmp_path / f"{name}.vtp")]) == 0
        mesh = pyvista.read(tmp_path / f"{name}.vtp")
        for field, radius in zip(("Rx", "Ry"), radii, strict=True):
            assert np.allclose(mesh.point_data[field], radius, rtol=1e-12, equal_nan=True), field
        assert mesh.point_data["normals"][:, 2].min() > 0.9
        assert mesh.area == pytest.approx(area, rel=2e-3)  # straight facets on arcs of 500 mm
        assert (tmp_path / f"{name}-rays.vtp").is_file()


def test_a_sheet_keeps_holes_and_turns_to_the_driver() -> None:
    surface = designed("sphere-1250").surface
    square = np.array([[-60.0, -60.0], [60.0, -60.0], [60.0, 60.0], [-60.0, 60.0]])
    whole, holed = sheet(surface, (square,)), sheet(surface, (square, square[::-1] / 3.0))
    areas = [np.linalg.norm(np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]), axis=1).sum() / 2.0
             for c in (one.vertices[one.faces] for one in (whole, holed))]
    # On a sphere's cap area grows by 1/cos of the slope, at most 0.5 % here.
    assert areas[0] == pytest.approx(120.0**2, rel=5e-3)
    assert areas[0] - areas[1] == pytest.approx(40.0**2, rel=5e-3)
    assert (holed.normals[:, 2] > 0.0).all()


def test_colours_span_what_is_there_and_signed_fields_lie_about_zero() -> None:
    values = np.concatenate([np.linspace(-1.0, 3.0, 10_001), [np.nan]])
    low, high = colour_range(values, signed=False)
    assert (low, high) == pytest.approx((-1.0, 3.0), abs=0.02)
    assert colour_range(values, signed=True) == pytest.approx((-3.0, 3.0), abs=0.02)
    low, high = colour_range(np.full(5, 950.0), signed=False)
    assert low < 950.0 < high
    assert colour_range(np.array([np.nan]), signed=False) == (-1.0, 1.0)


@pytest.mark.parametrize(("display", "words"), [(None, "DISPLAY is not set"), (":9999", "the display :9999")])
def test_no_window_without_a_display_and_nothing_is_written(display: str | None, words: str, tmp_path: Path) -> None:
    environment = {key: value for key, value in os.environ.items() if key != "DISPLAY"}
    environment |= {"DISPLAY": display} if display else {}
    result = command("progressive-c", "--out", tmp_path / "set", environment=environment)
    assert result.returncode == 2, result.stderr
    assert words in result.stderr
    assert "--png" in result.stderr
    assert "--vtp" in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("arguments", "words"), [
    (["nothing-such", "--vtp", "a"], "no such file or preset"), (["nothing.step", "--vtp", "a"], "no such file"),
    (["progressive-c", "--vtp", "a", "--out", "b"], "without --out"), (["progressive-c", "--vtp", "a", "--png"], "and --png"),
    (["progressive-c", "--png", "a.jpg"], "must end in .png"), (["progressive-c", "--png", "no/such/a.png"], "no folder"),
    (["progressive-c", "--vtp", "no/such/a.vtp"], "no folder")])
def test_bad_input_is_named_and_ends_with_2(arguments: list[str], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                            capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(["view", *arguments]) == 2
    assert words in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def screen(tmp_path: Path) -> Iterator[str]:
    """A display of its own, by Xvfb."""
    program = shutil.which("Xvfb")
    if program is None:
        pytest.skip("Xvfb is not installed: no window can be opened")
    number = 200 + os.getpid() % 500
    with (tmp_path / "xvfb.log").open("w") as log, subprocess.Popen(
            [program, f":{number}", "-screen", "0", "1500x900x24"], stdout=log, stderr=log) as server:
        for _ in range(100):
            if Path(f"/tmp/.X11-unix/X{number}").exists() or server.poll() is not None:
                break
            time.sleep(0.1)
        yield f":{number}"
        server.terminate()


def test_without_a_display_the_mirror_in_colours_and_the_rays_are_drawn(written: Path) -> None:
    """By EGL, into the set."""
    from PIL import Image

    picture = np.asarray(Image.open(written / "view.png").convert("RGB")).astype(int)
    rows, columns = picture.shape[:2]
    middle = picture[rows // 2 - 20: rows // 2 + 20, : columns // 2]
    # viridis from 400 to 1300 mm: Rx is 1250 mm over more than half of the mirror, and 400 mm at its outer edge.
    light, violet = ([(np.abs(middle - np.array(colour)).sum(axis=2) < 30).sum() for colour in ((220, 227, 25), (68, 1, 84))])
    assert light > 5 * violet > 0
    for part in (picture[: rows // 2, columns // 2:], picture[rows // 2:, columns // 2:]):  # near the mirror, and to the plane
        assert (part[..., 0] - part[..., 2] > 60).sum() > 3000  # orange, 59 rays of some hundred pixels
    assert set(json.loads((written / "manifest.json").read_text())["files"]) == {"mirror.vtp", "rays.vtp", "view.png"}


def test_a_window_opens_where_there_is_a_screen(screen: str, tmp_path: Path) -> None:
    """It stays until it is closed: what the display shows is looked at meanwhile."""
    from PIL import ImageGrab

    program = [sys.executable, "-m", "mirror_studio", "view", "progressive-c", "--out", str(tmp_path / "set")]
    with subprocess.Popen(program, env=os.environ | {"DISPLAY": screen}, stderr=subprocess.PIPE, text=True) as process:
        try:
            colours, until = 0, time.monotonic() + 120.0
            while colours < 100 and time.monotonic() < until and process.poll() is None:
                time.sleep(0.5)
                colours = len(ImageGrab.grab(xdisplay=screen).getcolors(1_000_000))
            assert process.poll() is None, process.stderr and process.stderr.read()
            assert colours >= 100
        finally:
            process.kill()  # VTK's loop does not hear a request


def test_where_nothing_can_draw_it_says_what_is_missing(tmp_path: Path) -> None:
    """VTK ends the process there, so the question comes first. The loader of EGL is shown no driver."""
    environment = {key: value for key, value in os.environ.items() if key != "DISPLAY"}
    result = command("progressive-c", "--out", tmp_path / "set", "--png",
                     environment=environment | {"__EGL_VENDOR_LIBRARY_DIRS": str(tmp_path)})
    if ctypes.util.find_library("OSMesa") is not None:
        assert result.returncode == 0, result.stderr
        return
    assert result.returncode == 2, result.stderr
    assert "apt-get install libegl1" in result.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("low", "high", "step"), [(400.0, 1258.0, 100.0), (-3.0, 3.0, 1.0), (0.0, 1.0, 0.2),
                                                   (940.0, 950.0, 2.0)])
def test_colour_bar_has_round_steps(low: float, high: float, step: float) -> None:
    assert round_step(low, high) == pytest.approx(step, rel=1e-12)
