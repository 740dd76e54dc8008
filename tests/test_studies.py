"""Studies: rows of sweeps and fronts, that they go on where they ended, and what they refuse."""

from __future__ import annotations

import csv
import os
import signal
import subprocess
import sys
import time
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mirror_cad
from mirror_cad.errors import MirrorError, SpecError
from mirror_studio.cli import run
from mirror_studio.explore.evaluate import Row, evaluate
from mirror_studio.explore.optimise import optimise
from mirror_studio.explore.store import STORE, Store
from mirror_studio.explore.study import Study, load_study
from mirror_studio.explore.sweep import sweep
from mirror_studio.progress import Progress
from mirror_studio.viewing_setup import ViewingSetup
from raytrace.measures.registry import registered
from raytrace.reflector import Reflector

QUIET = Progress(quiet=True)
SWEEP = """
spec = "progressive-c"
measures = ["lane_straightness_percent", "h_fov_traced_deg", "v_fov_left_section_deg"]
[vary]
"vertical.left_mm" = { values = [100.0, 1350.0] }
"horizontal.left_mm" = { from = 300.0, to = 600.0, count = 3 }
"""
OPTIMISE = """
spec = "progressive-c"
[vary]
"vertical.right_mm" = { from = 1000.0, to = 1900.0 }
"vertical.left_mm" = { from = 900.0, to = 1900.0 }
[optimise]
maximise = ["v_fov_left_traced_deg"]
minimise = ["lane_straightness_percent"]
population = 6
generations = 2
[optimise.limits]
h_fov_traced_deg = [44.0, inf]
"""


def study(tmp_path: Path, text: str, optimise: bool = False) -> Study:
    path = tmp_path / "study.toml"
    path.write_text(text, encoding="utf-8")
    return load_study(path, optimise)


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


@pytest.fixture(autouse=True)
def no_cluster(monkeypatch: pytest.MonkeyPatch) -> None:
    """These few designs are evaluated in this process: a cluster of others takes seconds to start."""
    monkeypatch.setattr("mirror_studio.explore.workers.FEW", 10_000)


@pytest.fixture
def swept(tmp_path: Path) -> tuple[Study, Path]:
    loaded, out = study(tmp_path, SWEEP), tmp_path / "out"
    assert sweep(loaded, out, QUIET) == {"ok": 3, "failed": 3}
    return loaded, out


def test_rows_are_the_measures_of_each_design(swept: tuple[Study, Path]) -> None:
    """Against a mirror made by hand; what cannot be made is a row with its cause."""
    import pyarrow.parquet

    found = rows(swept[1] / "rows.csv")
    assert list(found[0]) == ["vertical.left_mm", "horizontal.left_mm", "lane_straightness_percent", "h_fov_traced_deg",
                              "v_fov_left_section_deg", "status", "cause"]
    assert [(row["vertical.left_mm"], row["horizontal.left_mm"]) for row in found] == [
        (v, h) for v in ("100.0", "1350.0") for h in ("300.0", "450.0", "600.0")]
    assert all(row["status"] == "failed" and "vertical radius 100.0 mm" in row["cause"] for row in found[:3])
    assert all(row["h_fov_traced_deg"] == "" for row in found[:3])
    spec = mirror_cad.load_spec("progressive-c")
    mirror = mirror_cad.design(spec.model_copy(update={"horizontal": spec.horizontal.model_copy(update={"left_mm": 450.0})}))
    use = ViewingSetup.of(spec, mirror.box).in_use(Reflector.from_mirror(mirror), mirror)
    for name in swept[0].measures:
        assert float(found[4][name]) == pytest.approx(registered()[name].value(use), rel=1e-9)
    table = pyarrow.parquet.read_table(swept[1] / "rows.parquet").to_pylist()
    assert [row["status"] for row in table] == [row["status"] for row in found]
    assert [row["h_fov_traced_deg"] for row in table] == [
        None if row["h_fov_traced_deg"] == "" else float(row["h_fov_traced_deg"]) for row in found]


def test_the_same_command_goes_on_and_takes_no_row_twice(swept: tuple[Study, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """As after a kill amid the fourth row's line."""
    loaded, out = swept
    whole, undisturbed = (out / STORE).read_bytes(), (out / "rows.csv").read_bytes()
    lines = whole.splitlines(keepends=True)
    (out / STORE).write_bytes(b"".join(lines[:4]) + lines[4][: len(lines[4]) // 2])
    (out / "rows.csv").unlink()
    made: list[int] = []
    from mirror_studio.explore import workers

    evaluate = workers.evaluate
    monkeypatch.setattr(workers, "evaluate", lambda index, *rest: made.append(index) or evaluate(index, *rest))
    sweep(loaded, out, QUIET)
    assert made == [3, 4, 5]
    assert (out / "rows.csv").read_bytes() == undisturbed
    assert (out / STORE).read_bytes() == whole
    made.clear()
    sweep(loaded, out, QUIET)
    assert made == []


def test_two_studies_do_not_share_a_folder(swept: tuple[Study, Path], tmp_path: Path) -> None:
    other = study(tmp_path, SWEEP.replace("600.0", "610.0"))
    with pytest.raises(SpecError, match="rows of another study"):
        sweep(other, swept[1], QUIET)


@pytest.mark.parametrize("sampler", ["sobol", "halton", "latin"])
def test_samples_are_the_same_every_time_and_fill_the_box(tmp_path: Path, sampler: str) -> None:
    text = SWEEP.replace("[vary]", f'samples = 33\nsampler = "{sampler}"\nseed = 5\n[vary]')
    first, again = (study(tmp_path, text).designs() for _ in range(2))
    assert first == again
    assert len(first) == 33
    assert {values[0] for values in first} == {100.0, 1350.0}
    along = np.array([values[1] for values in first], dtype=float)
    assert ((along >= 300.0) & (along <= 600.0)).all()
    assert np.histogram(along, 4, (300.0, 600.0))[0].min() >= 6  # of 33, none of the quarters is forgotten
    other = study(tmp_path, text.replace("seed = 5", "seed = 6")).designs()
    assert other != first


def test_an_entry_of_a_list_is_varied(tmp_path: Path) -> None:
    text = """
spec = "perspective"
measures = ["v_fov_left_traced_deg"]
[vary]
"target.azimuth_deg.0" = { values = [-30.0, -95.0] }
"""
    out = tmp_path / "out"
    assert sweep(study(tmp_path, text), out, QUIET) == {"ok": 1, "failed": 1}
    assert "behind the mirror" in rows(out / "rows.csv")[1]["cause"]


def descendants(pid: int) -> list[int]:
    """A process and all that it has started."""
    found = [pid]
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in task.read_text().split():
            found += descendants(int(child))
    return found


def of_radii(folder: Path) -> None:
    """A specification of two constant laws, which are no sphere where only one is varied."""
    law = 'law = "constant"\nradius_mm = 950.0\n'
    (folder / "radii.toml").write_text(f'name = "radii"\n[horizontal]\n{law}[vertical]\n{law}')


def test_measures_on_the_vehicle(tmp_path: Path) -> None:
    of_radii(tmp_path)
    text = """
spec = "radii.toml"
scene = "motorway"
measures = ["magnification_least", "h_fov_traced_deg"]
[vary]
"horizontal.radius_mm" = { values = [900.0, 1000.0] }
"""
    out = tmp_path / "out"
    assert sweep(study(tmp_path, text), out, QUIET)["ok"] == 2
    small, large = (float(row["magnification_least"]) for row in rows(out / "rows.csv"))
    assert 0.0 < small < large < 1.0  # the flatter mirror shows things larger


def test_front_holds_what_no_row_beats(tmp_path: Path) -> None:
    loaded, out = study(tmp_path, OPTIMISE, True), tmp_path / "out"
    found = optimise(loaded, out, QUIET)
    assert found.evaluations == len(rows(out / "rows.csv")) == 12
    feasible = [row for row in rows(out / "rows.csv") if row["status"] == "ok" and float(row["h_fov_traced_deg"]) >= 44.0]
    wishes = [(float(row["lane_straightness_percent"]), -float(row["v_fov_left_traced_deg"])) for row in feasible]
    best = {one for one in wishes if not any(a <= one[0] and b <= one[1] and (a, b) != one for a, b in wishes)}
    front = rows(out / "front.csv")
    assert {(float(row["lane_straightness_percent"]), -float(row["v_fov_left_traced_deg"])) for row in front} == best
    assert [volume for _, volume in found.settled] == sorted(volume for _, volume in found.settled)
    before = (out / STORE).read_bytes()
    again = optimise(loaded, out, QUIET)
    assert (out / STORE).read_bytes() == before
    assert [row.values for row in again.front] == [row.values for row in found.front]
    fresh = optimise(loaded, tmp_path / "fresh", QUIET)
    assert fresh.front == found.front


def test_one_objective_ends_on_its_limit(tmp_path: Path) -> None:
    """The largest V-FOV of spheres no smaller than 43° across: a radius that the field of view settles."""
    of_radii(tmp_path)
    text = """
spec = "radii.toml"
[vary]
"horizontal.radius_mm" = { from = 700.0, to = 1500.0 }
[optimise]
maximise = ["h_fov_traced_deg"]
population = 4
generations = 20
[optimise.limits]
h_fov_section_deg = [-inf, 43.0]
"""
    found = optimise(study(tmp_path, text, True), tmp_path / "out", QUIET)
    assert found.active == ("h_fov_section_deg",)
    row = found.front[0]
    assert row.figures[1] == pytest.approx(43.0, abs=1e-3)
    from scipy.optimize import brentq

    def off(radius: float) -> float:
        law = mirror_cad.laws.Constant(radius_mm=radius)
        spec = mirror_cad.load_spec("sphere-950").model_copy(update={"horizontal": law})
        return float(np.degrees(mirror_cad.design(spec).section_fields_of_view()[0])) - 43.0

    assert row.values[0] == pytest.approx(brentq(off, 700.0, 1500.0, xtol=1e-3), abs=0.1)


def test_limits_that_nothing_meets_name_the_nearest(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "study.toml"
    path.write_text(OPTIMISE.replace("[44.0, inf]", "[60.0, inf]"), encoding="utf-8")
    assert run(["optimise", str(path), "--out", str(tmp_path / "out")]) == 3
    said = capsys.readouterr().err
    assert "no design meets optimise.limits; the nearest has vertical.right_mm = " in said
    assert "misses h_fov_traced_deg by" in said
    assert rows(tmp_path / "out" / "front.csv") == []


@pytest.mark.parametrize(("change", "said"), [
    (("lane_straightness_percent", "lane_straigthness_percent"), "unknown measure.*did you mean 'lane_straightness_percent'"),
    (("horizontal.left_mm", "horizontal.lft_mm"), r"vary\.horizontal\.lft_mm: unknown key; did you mean 'left_mm'"),
    (("from = 300.0", "from = 700.0"), r"is empty: from = 700 is not below to = 600"),
    (("values = [100.0, 1350.0]", "values = []"), r"must be a list with a value or more"),
    (("measures =", "mesures ="), r"mesures: unknown key; did you mean 'measures'"),
    (("progressive-c", "progresive-c"), r"did you mean the preset 'progressive-c'"),
    (('"h_fov_traced_deg"', '"magnification_least"'), r"measure of a mirror on its vehicle: give scene"),
    ((", count = 3", ""), r"a grid needs count"),
    (("[vary]", 'scene = "motorwy"\n[vary]'), r"did you mean the scene 'motorway'"),
])
def test_what_no_study_can_be_is_refused(tmp_path: Path, change: tuple[str, str], said: str) -> None:
    assert change[0] in SWEEP
    with pytest.raises(SpecError, match=said):
        study(tmp_path, SWEEP.replace(*change))


def test_command_ends_with_2_and_writes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "study.toml"
    path.write_text(SWEEP.replace("h_fov_traced_deg", "h_fov_trced_deg"), encoding="utf-8")
    assert run(["sweep", str(path), "--out", str(tmp_path / "out")]) == 2
    assert "did you mean 'h_fov_traced_deg'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.long
def test_no_scheduler_is_said(tmp_path: Path) -> None:
    with pytest.raises(MirrorError, match="no scheduler is reached there"):
        sweep(study(tmp_path, SWEEP), tmp_path / "out", QUIET, "tcp://127.0.0.1:9")


def test_the_front_is_what_its_step_files_hold(tmp_path: Path) -> None:
    """Every figure of the table, read back from the file that is made of the design."""
    optimise(study(tmp_path, OPTIMISE, True), tmp_path / "out", QUIET)
    front = rows(tmp_path / "out" / "front.csv")
    assert front
    assert all(float(row["step_apart"]) < 1e-6 for row in front)


def test_the_studies_that_come_along_can_be_read() -> None:
    names = sorted(each.name.removesuffix(".toml") for each in (resources.files("mirror_studio") / "studies").iterdir()
                   if each.name.endswith(".toml"))
    assert names == ["paper-front", "paper-left-radius", "perspective-heights"]
    for name in names:
        loaded = load_study(Path(name), optimise=name == "paper-front")
        assert loaded.scene == "motorway"


def test_two_commands_do_not_work_on_one_study(swept: tuple[Study, Path]) -> None:
    loaded, out = swept
    held = Store(out, loaded)
    try:
        with pytest.raises(SpecError, match="another command is at work on this study"):
            sweep(loaded, out, QUIET)
    finally:
        held.close()
    sweep(loaded, out, QUIET)


def test_a_full_disk_is_said_and_loses_nothing(tmp_path: Path) -> None:
    """A process whose files may have 600 bytes: what was written is whole, and the same command goes on."""
    path = tmp_path / "study.toml"
    path.write_text(SWEEP, encoding="utf-8")
    command = [sys.executable, "-m", "mirror_studio", "sweep", str(path), "--out", str(tmp_path / "out")]
    program = ("import os, resource; resource.setrlimit(resource.RLIMIT_FSIZE, (600, 600)); "
               f"os.execv({sys.executable!r}, {command!r})")
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 1
    assert "cannot be written: File too large; what is there is whole, and the same command goes on from it" in done.stderr
    assert "Traceback" not in done.stderr
    sweep(load_study(path), tmp_path / "out", QUIET)
    sweep(load_study(path), tmp_path / "whole", QUIET)
    assert (tmp_path / "out" / "rows.csv").read_bytes() == (tmp_path / "whole" / "rows.csv").read_bytes()


def deadly(index: int, *rest: Any) -> Row:
    """A design whose third takes its process with it, as a fault in compiled code does."""
    if index == 2:
        os._exit(9)
    return evaluate(index, *rest)


@pytest.mark.long
def test_a_design_that_kills_its_workers_is_a_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mirror_studio.explore.workers.FEW", 0)
    monkeypatch.setattr("mirror_studio.explore.workers.evaluate", deadly)
    assert sweep(study(tmp_path, SWEEP.replace("[100.0, 1350.0]", "[1300.0, 1350.0]")), tmp_path / "out", QUIET) == {
        "ok": 5, "failed": 1}
    row = rows(tmp_path / "out" / "rows.csv")[2]
    assert (row["status"], row["cause"]) == ("failed", "3 workers died on this design")


@pytest.mark.long
def test_one_worker_and_two_find_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By a scheduler of their own, as on a cluster."""
    from distributed import LocalCluster

    loaded, stores = study(tmp_path, OPTIMISE.replace("generations = 2", "generations = 4"), True), []
    for count in (1, 2):
        with LocalCluster(n_workers=count, threads_per_worker=1, dashboard_address=None) as cluster:
            optimise(loaded, tmp_path / str(count), QUIET, cluster.scheduler_address)
        stores.append((tmp_path / str(count) / STORE).read_bytes())
    assert stores[0] == stores[1]


@pytest.mark.long
def test_kills_of_the_command_lose_no_row(tmp_path: Path) -> None:
    """On a cluster of this machine's cores; ten times the command or a worker is killed at a random moment.

    The table is that of one process, undisturbed.
    """
    path = tmp_path / "study.toml"
    path.write_text(SWEEP.replace("count = 3", "count = 60"), encoding="utf-8")
    sweep(load_study(path), tmp_path / "whole", QUIET)
    command = [sys.executable, "-m", "mirror_studio", "sweep", str(path), "--out", str(tmp_path / "out")]
    random, store = np.random.default_rng(8), tmp_path / "out" / STORE
    for kill in range(5):
        with subprocess.Popen(command, start_new_session=True, stderr=subprocess.DEVNULL) as process:
            for what in ("worker", "command"):
                begun, before = time.monotonic(), store.stat().st_size if store.exists() else 0
                while process.poll() is None and time.monotonic() - begun < 90.0:
                    if store.exists() and store.stat().st_size > before + 1000 * kill:
                        break
                    time.sleep(0.05)
                time.sleep(float(random.uniform(0.0, 0.5)))
                if process.poll() is not None:
                    break
                if what == "command":
                    os.killpg(process.pid, signal.SIGKILL)
                else:
                    workers = [pid for pid in descendants(process.pid) if pid != process.pid]
                    if workers:
                        os.kill(int(random.choice(workers)), signal.SIGKILL)
    subprocess.run(command, check=True, stderr=subprocess.DEVNULL)
    assert (tmp_path / "out" / "rows.csv").read_bytes() == (tmp_path / "whole" / "rows.csv").read_bytes()
