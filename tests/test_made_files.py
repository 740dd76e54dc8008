"""Files of measured mirrors: what machines write is read, what is wrong is said, and all kinds go into one fit."""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from mirror_cad import design, load_spec
from mirror_cad.errors import FileError
from mirror_cad.made.inspection import inspect
from mirror_cad.made.measured_table import read_measured
from mirror_cad.mirror import Mirror
from mirror_cad.surfaces.differential import shape_operator
from mirror_studio.cli import run
from mirror_studio.inspect.alone import reference_of_points, write_laws
from mirror_studio.viewing_setup import ViewingSetup
from raytrace.measures.registry import registered
from raytrace.reflector import Reflector

Array = NDArray[np.float64]


@lru_cache
def mirror() -> Mirror:
    return design(load_spec("progressive-c"))


def points() -> Array:
    return mirror().grid_points(8.0)[:, :3]


def written(path: Path, text: str, encoding: str = "utf-8") -> Path:
    path.write_bytes(text.encode(encoding))
    return path


def table(values: Array, header: str = "x_mm,y_mm,z_mm", separator: str = ",", decimal: str = ".") -> str:
    rows = [separator.join(f"{v:.9f}" for v in row).replace(".", decimal) for row in values]
    return "\n".join([*([header] if header else []), *rows]) + "\n"


def inspection(tmp_path: Path, *data: Path, against: str = "progressive-c", more: tuple[str, ...] = ()) -> dict[str, object]:
    out = tmp_path / "out"
    assert run(["inspect", *map(str, data), "--against", against, "--out", str(out), *more]) in (0, 3)
    content: dict[str, object] = json.loads((out / "inspection.json").read_text("utf-8"))
    return content


@pytest.mark.parametrize(("text", "encoding"), [
    ("x_mm,y_mm,z_mm\n1.5,2,3\n4,5,6.25\n", "utf-8"),
    ("X [mm];Y [mm];Z [mm]\r\n1,5;2;3\r\n4;5;6,25\r\n", "utf-16"),
    ("1.5 2 3\n4 5 6.25\n", "ascii"),
    ("1,5\t2\t3\n4\t5\t6,25\n", "ascii"),
    ("# measured on a Tuesday\n# x y z\n1.5   2  3\n\n4 5 6.25", "ascii"),
    ("Point;x in mm;y in mm;z in mm;Remark\nA;1,5;2;3;-\nB;4;5;6,25;good\n", "cp1252"),
    ("sep=;\nx;y;z\n1.5;2;3\n4;5;6.25\n", "utf-8-sig"),
    ("x_m,y_m,z_m\n0.0015,0.002,0.003\n0.004,0.005,0.00625\n", "utf-8"),
    ("x_in,y_in,z_in\n0.059055118,0.078740157,0.118110236\n0.157480315,0.196850394,0.246062992\n", "utf-8"),
])
def test_tables_of_people_and_machines_are_read(tmp_path: Path, text: str, encoding: str) -> None:
    found = read_measured(written(tmp_path / "points.csv", text, encoding))
    at = np.stack([found.columns[key] for key in "xyz"], axis=1)
    assert at == pytest.approx(np.array([[1.5, 2.0, 3.0], [4.0, 5.0, 6.25]]), abs=1e-6)


@pytest.mark.parametrize(("text", "said"), [
    ("", "holds no table"),
    ("hello\n", "holds no three numbers"),
    ("x,y,z\n1,2,3\n1,2,foo\n", "line 3: 'foo' is no number"),
    ("x,y,z\n1,2,nan\n1,nan,3\n", "none of its"),
    ("a,b,c\n1,2,3\n", "no columns x and y"),
    ("x,y,z,x\n1,2,3,4\n", "two columns mean x"),
    ("x_mm,y_mm,z_in\n1,2,3\n", "different units"),
    ("1,5,2,5,3,5\n2,5,3,5,4,5\n", "decimal commas"),
    ("x,y,kx,ky\n1,2,3,4\n", "states no unit"),
])
def test_what_is_wrong_with_a_table_is_said(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(FileError, match=said):
        read_measured(written(tmp_path / "points.csv", text))


def test_rows_without_a_number_are_counted(tmp_path: Path) -> None:
    found = read_measured(written(tmp_path / "points.csv", "x,y,z\n1,2,3\n1,2,nan\n1,,3\n4,5,6\n"))
    assert (len(found), found.not_numbers) == (2, 2)


@pytest.mark.long
def test_a_set_is_written_and_its_json_has_the_contract_s_keys(tmp_path: Path) -> None:
    """And the STEP file is the mirror again, for every other command."""
    content = inspection(tmp_path, written(tmp_path / "points.csv", table(points())),
                         more=("--align", "none", "--scene", "motorway"))
    assert content["points"]["left_out"] == 0  # type: ignore[index]
    assert content["alignment"]["translation_mm"] == [0.0, 0.0, 0.0]  # type: ignore[index]
    assert set(content["height"]) >= {"max_mm", "rms_mm"}  # type: ignore[call-overload]
    assert set(content["slope"]) >= {"max_arcmin", "rms_arcmin"}  # type: ignore[call-overload]
    for key in ("k1", "k2", "kx", "ky", "twist"):
        assert set(content[key]) >= {"max_percent", "rms_percent", "sigma_percent", "max_at_mm"}  # type: ignore[call-overload]
        assert abs(content[key]["max_percent"]) < 0.01  # type: ignore[index]
    assert content["verdict"] is None
    measures = content["driver"]["measures"]  # type: ignore[index]
    assert measures["h_fov_traced_deg"]["measured"] == pytest.approx(measures["h_fov_traced_deg"]["designed"], abs=1e-4)
    for name in ("horizon_either_deg", "magnification_least", "ground_nearest_m"):  # on the scene's vehicle
        assert measures[name]["interval"][0] <= measures[name]["measured"] <= measures[name]["interval"][1]
        assert measures[name]["measured"] == pytest.approx(measures[name]["designed"], rel=1e-4)
    assert content["hidden_by_alignment"] == {"max_mm": 0.0, "rms_mm": 0.0, "sigma_mm": None}
    out = tmp_path / "out"
    with (out / "progressive-c-probes.csv").open(encoding="utf-8") as stream:
        assert len(stream.readlines()) == 26
    assert {"report.html", "progressive-c-maps.csv", "progressive-c-measured.step"} <= {path.name for path in out.iterdir()}
    assert run(["trace", str(out / "progressive-c-measured.step"), "--out", str(tmp_path / "traced")]) == 0
    traced = json.loads((tmp_path / "traced" / "metrics.json").read_text("utf-8"))
    assert traced["h_fov_deg"]["traced"] == pytest.approx(measures["h_fov_traced_deg"]["measured"], abs=0.02)


@pytest.mark.long
def test_a_mirror_that_reflects_from_its_back_is_seen_through_its_glass(tmp_path: Path) -> None:
    """As the command that traces the design has it."""
    spec = written(tmp_path / "back.toml", 'name = "back"\n[horizontal]\nlaw = "constant"\nradius_mm = 1200.0\n[vertical]\n'
                   'law = "constant"\nradius_mm = 1200.0\n[surface]\nmethod = "sphere"\n[glass]\nreflecting = "back"\n'
                   "thickness_mm = 4.0\n")
    made = design(load_spec(spec))
    content = inspection(tmp_path, written(tmp_path / "points.csv", table(made.grid_points(8.0)[:, :3])), against=str(spec),
                         more=("--align", "none"))
    seen = content["driver"]["measures"]["h_fov_traced_deg"]  # type: ignore[index]
    use = ViewingSetup.of(made.spec, made.box).in_use(Reflector.from_mirror(made), made)
    assert seen["designed"] == pytest.approx(registered()["h_fov_traced_deg"].value(use), abs=1e-9)
    assert seen["measured"] == pytest.approx(seen["designed"], abs=1e-3)  # degrees: points to nine decimals


def test_units_are_found_or_their_fault_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Metres without a unit are taken for metres; inches that say they are mm are refused."""
    metres = inspection(tmp_path, written(tmp_path / "m.csv", table(points() / 1000.0, "x,y,z")))
    assert any("in m" in note for note in metres["notes"])  # type: ignore[union-attr]
    assert abs(metres["height"]["max_mm"]) < 1e-3  # type: ignore[index]  # nine decimals of a metre
    for factor in (10.0, 25.4, 1000.0):
        wrong = written(tmp_path / "wrong.csv", table(points() / factor))
        assert run(["inspect", str(wrong), "--against", "progressive-c", "--out", str(tmp_path / "no")]) == 2
        assert f"{factor:g} mm to the unit" in capsys.readouterr().err
        assert not (tmp_path / "no").exists()


@pytest.mark.parametrize(("arguments", "said"), [
    (["--sigma-mm", "0"], "--sigma-mm 0"), (["--sigma-mm", "-1"], "--sigma-mm -1"), (["--gauge-mm", "0"], "--gauge-mm 0"),
    (["--align", "321x"], "align"), (["--datum", "1,2"], "321 lays a mirror on three places"),
    (["--datum", "1;2"], "--datum 1;2: must be X,Y"),
    (["--datum", "-1,2", "--datum", "3,4", "--datum", "5,-6"], "--datum belongs to --align 321"),
    (["--scene", "motorwy"], "did you mean the scene 'motorway'"),
])
def test_bad_options_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], said: str) -> None:
    data = written(tmp_path / "points.csv", table(points()))
    assert run(["inspect", str(data), "--against", "progressive-c", "--out", str(tmp_path / "no"), *arguments]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "no").exists()


@pytest.mark.long
def test_slopes_curvatures_and_readings_go_into_one_fit(tmp_path: Path) -> None:
    """A mirror that is 2 % too curved, by each kind of measurement and by all of them together."""
    at, spec = points(), mirror()
    x, y = at[:, 0], at[:, 1]
    extra = 0.01 * (x * x + y * y) / 1250.0  # of the depth of a sphere of 1250 mm: 2 % of its curvature
    heights = at - np.stack([0.0 * x, 0.0 * x, extra], axis=1)
    d = spec.surface.derivatives(x, y)
    slopes = np.stack([d["u"][:, 2] - 0.02 * x / 1250.0, d["v"][:, 2] - 0.02 * y / 1250.0], axis=1)
    changed = {key: value.copy() for key, value in d.items()}
    for key, values in (("s", -extra), ("u", -0.02 * x / 1250.0), ("v", -0.02 * y / 1250.0),
                        ("uu", np.full(x.size, -0.02 / 1250.0)), ("vv", np.full(x.size, -0.02 / 1250.0))):
        changed[key][:, 2] += values
    w = shape_operator(changed)
    rng = np.random.default_rng(1)
    files = {
        "heights": written(tmp_path / "h.csv", table(heights + [0.0, 0.0, 1.0] * rng.normal(0.0, 1e-3, heights.shape))),
        "slopes": written(tmp_path / "s.csv", table(np.column_stack([x, y, slopes + rng.normal(0.0, 1e-5, slopes.shape)]),
                                                    "x_mm,y_mm,slope_x,slope_y")),
        "curvatures": written(tmp_path / "k.csv", table(np.column_stack([x, y, 1e3 * w.w11, 1e3 * w.w22, 1e3 * w.w12]),
                                                        "x_mm,y_mm,kx_per_m,ky_per_m,twist_per_m")),
        "readings": written(tmp_path / "r.csv", "x_mm,y_mm,angle_deg,leg_mm,radius_mm\n"
                            f"60,0,90,38,{1.0 / float(_ky(w, x, y, 60.0)):.3f}\n")}
    wanted = np.sqrt(np.mean(_percent(w, d)[np.abs(x) < 90.0] ** 2))
    sigmas = {}
    alone = {key: [path] for key, path in files.items() if key != "readings"}
    for name, data in (alone | {"all": list(files.values())}).items():
        content = inspection(tmp_path, *data, more=("--align", "none"))
        ky = content["ky"]
        sigmas[name] = ky["sigma_percent"]  # type: ignore[index]
        assert ky["rms_percent"] == pytest.approx(wanted, rel=0.1), name  # type: ignore[index]
    assert sigmas["all"] <= min(sigmas[key] for key in ("heights", "slopes", "curvatures")) * 1.05


def _percent(w: object, d: dict[str, Array]) -> Array:
    return 100.0 * (w.w22 / shape_operator(d).w22 - 1.0)  # type: ignore[attr-defined]


def _ky(w: object, x: Array, y: Array, at: float) -> float:
    row = int(np.argmin(np.hypot(x - at, y)))
    return float(w.w22[row])  # type: ignore[attr-defined]


def test_a_reading_beside_the_mirror_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = written(tmp_path / "points.csv", table(points()))
    reading = written(tmp_path / "r.csv", "x_mm,y_mm,angle_deg,leg_mm,radius_mm\n112,0,0,38,1200\n")
    assert run(["inspect", str(data), str(reading), "--against", "progressive-c", "--out", str(tmp_path / "no")]) == 2
    assert "stands beside the mirror" in capsys.readouterr().err


def test_without_a_design_the_nearest_sphere_and_the_laws_are_told(tmp_path: Path) -> None:
    """Of a sphere its radius; of a progressive mirror a specification that is its laws again."""
    grid = points()
    sphere = np.column_stack([grid[:, :2], np.sqrt(1200.0**2 - grid[:, 0] ** 2 - grid[:, 1] ** 2) - 1200.0])
    reference, found = reference_of_points("ball", sphere)
    assert found.radius_mm == pytest.approx(1200.0, rel=1e-9)
    assert found.rms_mm < 1e-9
    low, high = grid.min(axis=0), grid.max(axis=0)
    assert reference.nominal.box == pytest.approx((low[0], high[0], low[1], high[1]), abs=0.5)

    laid, _ = reference_of_points("free", grid)
    told = write_laws(tmp_path, "free", inspect(laid.nominal, grid, align="none", given=laid.given))
    again = design(load_spec(tmp_path / "free-laws.toml"))
    x = np.linspace(-90.0, 90.0, 37)
    for law, wanted in ((again.curvature.horizontal, mirror().curvature.horizontal),
                        (again.curvature.vertical, mirror().curvature.vertical)):
        assert np.abs(law(x) / wanted(x) - 1.0).max() < 0.03  # the mean over a gauge, and what the surface itself misses
    assert abs(told["horizontal"]["zone_begins_at_mm"]) < 40.0  # type: ignore[index, call-overload, arg-type]
