"""The files of one mirror: opened by other programs, swapped in whole, and healed after a kill."""

from __future__ import annotations

import hashlib
import itertools
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mirror_cad
from mirror_cad.occt.shapes import faces_of
from mirror_cad.occt.step import OPTICAL_FACE, read_step
from mirror_cad.surfaces.differential import principal_curvatures_of, shape_operator
from mirror_studio.build.folder import MANIFEST, heal, new_set
from tests.conftest import constant, designed, spec_of

SMALL = """
name = "small"
[horizontal]
law = "constant"
radius_mm = 900
[vertical]
law = "constant"
radius_mm = 900
[outline]
width_mm = 60
left_height_mm = 60
right_height_mm = 60
corner_radius_mm = 10
[view]
width_px = 64
"""


def command(*arguments: object, cwd: Path, **options: Any) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "mirror_studio", *map(str, arguments)], cwd=cwd, capture_output=True,
                          text=True, timeout=120, **options)


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One small mirror, built by the command as a user would."""
    folder = tmp_path_factory.mktemp("built")
    (folder / "small.toml").write_text(SMALL)
    result = command("build", "small.toml", "--json", cwd=folder)
    assert result.returncode == 0, result.stderr
    assert set(json.loads(result.stdout)) >= {"h_fov_deg", "v_fov_left_deg", "lane_straightness_percent", "stl_on_plane_mm"}
    return folder / "exports" / "small"


def test_every_file_of_the_contract_is_there_and_hashed(built: Path) -> None:
    contract = {"small.step", "small-surface.step", "small.stl", "small-points.csv", "outline.dxf", "driver-view.png",
                "metrics.json", "deviation.json", "report.html", "manifest.json"}
    of_report = {"small-report.json", *(f"small-{name}.csv" for name in (
        "verdicts", "sampling", "maps", "histogram", "sections", "stages", "step", "probe", "measures", "lane"))}
    names = {path.name for path in built.iterdir()}
    assert names - {"small-lane.csv"} == contract | of_report - {"small-lane.csv"}  # not every mirror shows the lane
    manifest = json.loads((built / "manifest.json").read_text())
    assert manifest["schema"] == 1
    assert set(manifest) >= {"spec", "versions", "tolerances", "files"}
    assert set(manifest["files"]) == names - {"manifest.json"}
    for name, digest in manifest["files"].items():
        assert hashlib.sha256((built / name).read_bytes()).hexdigest() == digest
    assert [path.name for path in built.parent.iterdir()] == ["small"]


def test_deviation_json_has_the_contract_keys(built: Path) -> None:
    deviation = json.loads((built / "deviation.json").read_text())
    assert set(deviation) == {"stages", "total", "verdicts"}
    assert list(deviation["stages"]) == ["model", "integration", "fit", "step", "stl"]
    keys = {f"{k}_{what}" for k in ("k1", "k2", "kx", "ky", "twist")
            for what in ("max_percent", "rms_percent", "max_per_m", "max_at_mm")}
    keys |= {"shape_max_percent", "shape_rms_percent", "shape_max_per_m", "shape_rms_per_m", "shape_max_at_mm",
             "sag_max_mm", "sag_max_at_mm", "slope_max_arcsec", "slope_max_at_mm"}
    for stage in ("model", "integration", "fit", "step"):
        assert set(deviation["stages"][stage]) == keys
    assert set(deviation["total"]) == keys
    assert {"height_max_mm", "normal_max_deg"} <= set(deviation["stages"]["stl"])
    assert deviation["stages"]["stl"]["height_max_mm"] <= 0.01
    assert deviation["verdicts"] == {"numerical": True, "part": None}


def test_step_is_ap242_in_mm_with_a_named_and_coloured_face(built: Path) -> None:
    text = (built / "small.step").read_text()
    assert "AP242" in text.split("ENDSEC")[0]
    assert f"ADVANCED_FACE('{OPTICAL_FACE}'" in text
    assert "COLOUR_RGB" in text
    assert ".MILLI.,.METRE." in text.replace(" ", "")
    assert text.count("MANIFOLD_SOLID_BREP") == 1
    for surface in ("PLANE(", "CYLINDRICAL_SURFACE", "OFFSET_SURFACE", "SURFACE_OF"):
        assert surface not in text  # back and rim are plain B-splines
    sheet = read_step(built / "small-surface.step").faces
    assert [face.name for face in sheet] == [OPTICAL_FACE]
    assert sheet[0].surface.domain == pytest.approx((-45, 45, -45, 45), abs=1e-9)
    assert "'trim curve'" in (built / "small-surface.step").read_text()


def test_gmsh_opens_the_step_with_the_same_volume(built: Path) -> None:
    import gmsh

    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(built / "small.step"))
        volumes = gmsh.model.getEntities(3)
        assert len(volumes) == 1
        theirs = gmsh.model.occ.getMass(*volumes[0])
    finally:
        gmsh.finalize()
    ours = json.loads((built / "metrics.json").read_text())["plate"]["volume_mm3"]
    assert theirs == pytest.approx(ours, rel=1e-6)


@pytest.mark.parametrize("name", ["progressive-c", "sphere-950"])
def test_volume_is_that_of_the_exact_normal_offset(name: str) -> None:
    """Steiner's formula for a plate with sides along the normals: V = ∫(t − t²·H + t³/3·K) dA, H and K convex positive."""
    mirror = designed(name)
    t = mirror.spec.glass.thickness_mm
    # Gauss–Legendre in y between the outline's crossings, on many x: the integrand is smooth inside.
    polygon = mirror.outline.polyline(1e-5)
    node, weight = np.polynomial.legendre.leggauss(24)
    x_node, x_weight = np.polynomial.legendre.leggauss(12)
    corners = np.unique(np.round(np.concatenate([[s.start[0] for s in mirror.outline.segments], [-115, 115]]), 9))
    total = area = 0.0
    for low, high in itertools.pairwise(corners):
        cuts = np.linspace(low, high, 9)
        for a, b in itertools.pairwise(cuts):
            for x, wx in zip(0.5 * (a + b) + 0.5 * (b - a) * x_node, 0.5 * (b - a) * x_weight, strict=True):
                start, end = polygon, np.roll(polygon, -1, axis=0)
                crossing = (start[:, 0] <= x) != (end[:, 0] <= x)
                share = (x - start[crossing, 0]) / (end[crossing, 0] - start[crossing, 0])
                ys = np.sort(start[crossing, 1] + share * (end[crossing, 1] - start[crossing, 1]))
                y = 0.5 * (ys[0] + ys[1]) + 0.5 * (ys[1] - ys[0]) * node
                d = mirror.surface.derivatives(np.full_like(y, x), y)
                k1, k2 = principal_curvatures_of(shape_operator(d))
                element = np.linalg.norm(np.cross(d["u"], d["v"]), axis=1)
                scale = wx * 0.5 * (ys[1] - ys[0])
                area += scale * float(weight @ element)
                total += scale * float(weight @ (element * (t - t**2 * 0.5 * (k1 + k2) + t**3 / 3 * k1 * k2)))
    # The quadrature over the rounded corners converges to some 1e-7.
    assert mirror.plate.area_mm2 == pytest.approx(area, rel=1e-6)
    assert mirror.plate.volume_mm3 == pytest.approx(total, rel=1e-6)


def test_back_and_rim_follow_the_true_offset() -> None:
    mirror = designed("progressive-c")
    assert mirror.plate.back_error_mm <= 1e-3
    from OCP.BRep import BRep_Tool
    from OCP.Geom import Geom_BSplineSurface

    for face in faces_of(mirror.plate.solid):
        assert isinstance(BRep_Tool.Surface_s(face), Geom_BSplineSurface)
    # Rim: every point of a side lies on the segment from a point of the outline along its normal.
    from mirror_cad.occt.convert import face_as_bspline
    from mirror_cad.surfaces.differential import normals

    sides = [face_as_bspline(face)[0] for face in faces_of(mirror.plate.solid)]
    for side in (surface for surface in sides if min(surface.poles.shape[:2]) == 2):
        u = np.linspace(*side.domain[:2], 41)
        v = np.linspace(*side.domain[2:], 41)
        along, across = (u, v) if side.degree_v == 1 else (v, u)
        ends = (across[0], across[-1])
        front, back = ((side.evaluate(along, e) if side.degree_v == 1 else side.evaluate(e, along)) for e in ends)
        if front[:, 2].mean() < back[:, 2].mean():
            front, back = back, front
        d = mirror.surface.derivatives(np.clip(front[:, 0], -115, 115), np.clip(front[:, 1], -185, 185))
        assert np.abs(front - d["s"]).max() < 1e-6
        assert np.linalg.norm(back - (front - 3.0 * normals(d["u"], d["v"])), axis=1).max() < 1e-3


def test_the_same_solid_for_build123d_and_cadquery() -> None:
    mirror = designed("sphere-1050")
    part, other = mirror.to_build123d(), mirror.to_cadquery()
    assert part.volume == pytest.approx(mirror.plate.volume_mm3, rel=1e-12)
    assert other.val().Volume() == pytest.approx(mirror.plate.volume_mm3, rel=1e-12)
    assert other.val().isValid()


def test_thickness_above_the_convex_radius_is_refused() -> None:
    mirror = mirror_cad.design(spec_of(constant(200.0), constant(250.0), glass={"thickness_mm": 210.0}))
    with pytest.raises(mirror_cad.SolidError, match=r"thickness_mm = 210 .* smallest convex radius, 1\d\d\.\d\d mm"):
        _ = mirror.plate


def test_two_builds_are_byte_identical_with_source_date_epoch(tmp_path: Path) -> None:
    (tmp_path / "small.toml").write_text(SMALL)
    sets = []
    for name in ("one", "two"):
        environment = os.environ | {"SOURCE_DATE_EPOCH": "1400000000"}
        assert command("build", "small.toml", "--out", name, cwd=tmp_path, env=environment).returncode == 0
        sets.append(json.loads((tmp_path / name / "manifest.json").read_text())["files"])
    differing = {name for name in sets[0] if sets[0][name] != sets[1][name]}
    assert not differing
    assert "2014-05-13" in (tmp_path / "one" / "small.step").read_text()


# --- the folder ---------------------------------------------------------------------------------------------------------


def old_set(out: Path) -> None:
    out.mkdir(parents=True)
    (out / "a.txt").write_text("old")
    (out / "gone.txt").write_text("old")
    digest = hashlib.sha256(b"old").hexdigest()
    (out / MANIFEST).write_text(json.dumps({"files": {"a.txt": digest, "gone.txt": digest}}))
    (out / "mine").mkdir()
    (out / "mine" / "notes.txt").write_text("foreign")


def write_new(folder: Path) -> None:
    (folder / "a.txt").write_text("new")
    (folder / MANIFEST).write_text(json.dumps({"files": {"a.txt": ""}}))


def fail_after_writing(folder: Path) -> None:
    write_new(folder)
    raise ZeroDivisionError


def test_a_new_set_replaces_the_old_one_and_keeps_foreign_files(tmp_path: Path) -> None:
    out = tmp_path / "set"
    old_set(out)
    with new_set(out) as folder:
        write_new(folder)
    assert (out / "a.txt").read_text() == "new"
    assert not (out / "gone.txt").exists()
    assert (out / "mine" / "notes.txt").read_text() == "foreign"
    assert [path.name for path in tmp_path.iterdir()] == ["set"]


def test_an_error_leaves_the_old_set_and_nothing_else(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "set"
    with pytest.raises(ZeroDivisionError), new_set(out) as folder:
        fail_after_writing(folder)
    assert list(tmp_path.iterdir()) == []
    old_set(out)
    with pytest.raises(ZeroDivisionError), new_set(out) as folder:
        fail_after_writing(folder)
    assert (out / "a.txt").read_text() == "old"
    assert [path.name for path in out.parent.iterdir()] == ["set"]


def test_files_that_another_manifest_names_are_kept(tmp_path: Path) -> None:
    out = tmp_path / "set"
    out.mkdir()
    (out / "keep.txt").write_text("mine")
    (out / MANIFEST).write_text(json.dumps({"name": "app", "files": ["keep.txt"]}))
    with new_set(out) as folder:
        write_new(folder)
    assert (out / "keep.txt").read_text() == "mine"


@pytest.mark.parametrize("stage", ["written", "ready", "between the renames", "after them"])
def test_a_kill_at_any_stage_is_healed(tmp_path: Path, stage: str) -> None:
    out = tmp_path / "set"
    old_set(out)
    ready, old = tmp_path / ".set.mirror-cad-ready", tmp_path / ".set.mirror-cad-old"
    left = tmp_path / ".set.new-999999999-abc"
    (left if stage == "written" else ready).mkdir()
    write_new(left if stage == "written" else ready)
    if stage == "between the renames":
        out.rename(old)
    if stage == "after them":
        out.rename(old)
        ready.rename(out)
    heal(out)
    assert (out / "a.txt").read_text() == ("old" if stage in ("written", "ready") else "new")
    assert [path.name for path in tmp_path.iterdir()] == ["set"]


@pytest.mark.parametrize("tries", [3, pytest.param(20, marks=pytest.mark.long)])
def test_killing_the_command_at_random_moments_leaves_a_whole_set(tmp_path: Path, tries: int) -> None:
    (tmp_path / "small.toml").write_text(SMALL)
    out = tmp_path / "exports" / "small"
    start = time.perf_counter()
    assert command("build", "small.toml", cwd=tmp_path).returncode == 0
    duration = time.perf_counter() - start
    (out / "mine.txt").write_text("foreign")
    rng = random.Random(7)
    for _ in range(tries):
        process = subprocess.Popen([sys.executable, "-m", "mirror_studio", "build", "small.toml"], cwd=tmp_path,
                                   stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(rng.uniform(0.2, 1.1) * duration)
        process.send_signal(signal.SIGKILL)
        process.wait()
    heal(out)
    names = json.loads((out / "manifest.json").read_text())["files"]
    assert set(names) | {"manifest.json", "mine.txt"} == {path.name for path in out.iterdir()}
    assert all(hashlib.sha256((out / name).read_bytes()).hexdigest() == digest for name, digest in names.items())
    assert [path.name for path in out.parent.iterdir()] == ["small"]


def test_a_full_disk_leaves_nothing_and_says_so(tmp_path: Path) -> None:
    """A tmpfs of 1 MB, too small for one set; without the right to mount, a limit on the size of files does the same."""
    small = tmp_path / "disk"
    small.mkdir()
    (tmp_path / "small.toml").write_text(SMALL)
    mounted = shutil.which("mount") is not None and subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=300k", "tmpfs", small], capture_output=True, check=False).returncode == 0
    try:
        if mounted:
            result = command("build", "small.toml", "--out", small / "set", cwd=tmp_path)
        else:
            import resource

            result = command("build", "small.toml", "--out", small / "set", cwd=tmp_path,
                             preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000)))
        assert result.returncode == 1
        assert "Traceback" not in result.stderr
        assert result.stderr.strip().splitlines()[-1].startswith("mirror-cad: ")
        assert list(small.iterdir()) == []
    finally:
        if mounted:
            subprocess.run(["umount", small], check=True)


def test_a_current_folder_that_is_gone_is_said(tmp_path: Path) -> None:
    folder = tmp_path / "gone"
    folder.mkdir()
    inside = ("import os, runpy, sys; os.rmdir(os.getcwd()); "
              f"sys.argv = ['mirror-cad', 'build', 'sphere-950', '--out', {str(tmp_path / 'set')!r}]; "
              "runpy.run_module('mirror_studio', run_name='__main__')")
    result = subprocess.run([sys.executable, "-c", inside], cwd=folder, capture_output=True, text=True, timeout=120)
    assert result.returncode == 2, result.stderr
    assert "the current folder is there no longer" in result.stderr
    assert not (tmp_path / "set").exists()


def test_nothing_but_results_goes_to_the_standard_output(tmp_path: Path) -> None:
    """The kernel has words of its own for an STL file that is cut off."""
    (tmp_path / "cut.stl").write_bytes(b"mirror".ljust(80) + (1000).to_bytes(4, "little") + bytes(700))
    result = command("trace", "cut.stl", "--json", cwd=tmp_path)
    assert (result.returncode, result.stdout) == (2, "")
    assert "not an STL file with triangles in it" in result.stderr
