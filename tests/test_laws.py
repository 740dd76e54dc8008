"""Curvature laws: each is one file, a law of one's own is known everywhere, and each is what it says."""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from pydantic import Field

import mirror_cad as mc
from mirror_cad.keys import Number, Radius, Shown
from mirror_cad.laws import CurvatureLaw, Law, Matched, Span
from mirror_cad.laws.matched import open_number, with_solved
from mirror_cad.laws.matching import solve_match
from mirror_cad.section_fov import circle_section_fov
from mirror_cad.spec.file import spec_as_json, validate_spec
from mirror_studio.build.results import Metrics
from mirror_studio.drive.sensitivity import with_radii
from mirror_studio.report.page import facts
from mirror_studio.web import controls, state
from mirror_studio.web.uploads import Uploads
from tests.conftest import constant, spec_of

Array = NDArray[np.float64]
PACKAGES = ("mirror_cad", "raytrace", "mirror_studio")
HOME = Path(__file__).resolve().parent.parent
SPAN = Span(-115.0, 115.0)


# --- a law of one's own, known from this file alone ------------------------------------------------------------------


class Wave(Matched):
    """κ = (1 + depth·sin(2π·turns·t))/R."""

    title = "wavy"
    open_key = "depth"

    law: Literal["wave"] = "wave"
    radius_mm: Annotated[Radius, Shown("{axis} on average", 100.0, 2000.0, 5.0, 1, start="$right", drag="everywhere")]
    depth: Annotated[float | Literal["match"], open_number(0.0, 0.9), Shown("Depth", 0.0, 0.9, 0.01, start=0.1)]
    turns: Annotated[Number, Field(ge=0.25, le=4.0)]

    def over(self, span: Span) -> CurvatureLaw:
        def kappa(x: Array) -> Array:
            return (1.0 + self.parameter * np.sin(2.0 * np.pi * self.turns * span.t(x))) / self.radius_mm

        return CurvatureLaw(kappa, (mc.laws.Break(span.left_mm, 0), mc.laws.Break(span.right_mm, 0)), "wave law")

    def scaled(self, factor: float) -> Self:
        return self.model_copy(update={"radius_mm": factor * self.radius_mm})

    def in_words(self, solved: float | None = None) -> str:
        return f"{self.turns:g} waves about {self.radius_mm:g} mm, {self.open_in_words(solved)} deep"

    def candidates(self) -> Array:
        return np.linspace(0.0, 0.9, 10)


WAVE = {"law": "wave", "radius_mm": 900, "depth": 0.2, "turns": 1}


@pytest.fixture
def wave() -> Iterator[None]:
    """The law is known for as long as a test lasts."""
    mc.laws.register(Wave)
    try:
        yield
    finally:
        mc.laws.unregister(Wave)


@pytest.mark.usefixtures("wave")
def test_a_law_of_ones_own_is_read_from_a_file_and_designed(tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text('[horizontal]\nlaw = "wave"\nradius_mm = 900\ndepth = 0.2\nturns = 1\n'
                                       'level_at = "left"\n[vertical]\nlaw = "constant"\nradius_mm = 1250\n')
    mirror = mc.design(mc.load_spec(tmp_path / "own.toml"))
    x = np.linspace(-114.0, 114.0, 31)
    wanted = (1.0 + 0.2 * np.sin(2.0 * np.pi * (115.0 - x) / 230.0)) / 900.0
    assert np.abs(mirror.curvature.horizontal(x) - wanted).max() < 1e-15
    assert mirror.fit.met
    assert float(mirror.exact.profile.slope(np.array([-115.0]))[0]) == pytest.approx(0.0, abs=1e-15)
    content = json.dumps(spec_as_json(mirror.spec))
    assert spec_as_json(validate_spec(json.loads(content))) == json.loads(content)


@pytest.mark.usefixtures("wave")
@pytest.mark.parametrize(("keys", "said"), [
    ({"turn": 2}, "horizontal.turn: unknown key; did you mean 'turns'?"),
    ({"turns": 9}, "horizontal.turns = 9: must be at least 0.25 and at most 4"),
    ({"depth": 2}, 'horizontal.depth = 2: must be "match" or a number at least 0 and at most 0.9'),
    ({"exponent": 2.0}, "horizontal.exponent: this key belongs to law = 'power' (the law here is 'wave')"),
    ({"depth": "match"}, 'depth = "match" needs a section [horizontal.match]'),
    ({"law": "wav"}, "horizontal.law = \"wav\": must be one of constant, linear, power, zones, table, expression, wave; did "
                     "you mean 'wave'?"),
])
def test_what_is_wrong_in_a_law_of_ones_own_is_said_as_of_any_other(keys: dict[str, object], said: str) -> None:
    with pytest.raises(mc.SpecError) as caught:
        spec_of(WAVE | keys, constant(900.0))
    assert said in str(caught.value)
    with pytest.raises(mc.SpecError, match=r"horizontal\.depth: this key belongs to law = 'wave'"):
        spec_of({**constant(900.0), "depth": 0.1}, constant(900.0))


@pytest.mark.usefixtures("wave")
def test_the_open_number_of_a_law_of_ones_own_is_solved_for() -> None:
    law = Wave(radius_mm=700, depth="match", turns=0.5, match=mc.laws.Match(sphere_mm=650))
    found = solve_match(law, 762.0, SPAN, -115.0, 115.0, 0.0)
    assert found is not None
    mirror = mc.design(mc.MirrorSpec(horizontal=law, vertical=mc.laws.Constant(radius_mm=1250)))
    assert mirror.matched == found
    assert mirror.section_fields_of_view()[0] == pytest.approx(circle_section_fov(1.0 / 650.0, 115.0, 762.0), abs=1e-12)
    # What scales it is its own: the curvature of the design is 1/1.05 everywhere, with the depth that was found.
    scaled = mc.design(with_radii(mirror.spec, 1.05))
    x = np.linspace(-110.0, 110.0, 23)
    np.testing.assert_allclose(scaled.curvature.horizontal(x) * 1.05, mirror.curvature.horizontal(x), rtol=1e-13)


@pytest.mark.usefixtures("wave")
def test_the_page_is_sent_the_controls_of_a_law_of_ones_own() -> None:
    sent = {control["key"]: control for group in controls.controls() for control in group["controls"]}
    for section in ("horizontal", "vertical"):
        assert ("wave", "wavy") in sent[f"{section}.law"]["choices"]
        turns = sent[f"{section}.turns"]  # says nothing of how it is shown: the schema's range and its name
        assert (turns["kind"], turns["label"], turns["low"], turns["high"], turns["law"]) == ("number", "turns", 0.25, 4.0,
                                                                                              ("wave",))
        assert sent[f"{section}.radius_mm"]["law"] == ("constant", "wave")
        assert (sent[f"{section}.depth"]["low"], sent[f"{section}.depth"]["high"]) == (0.0, 0.9)
    assert "wave" in sent["horizontal.match.sphere_mm"]["law"]
    law = controls.laws()["wave"]
    assert law["open"] == "depth"
    assert law["points"] == [{"key": "radius_mm", "at": "everywhere", "label": "{axis} on average"}]
    # What the page puts in when the law is chosen is a law.
    start = {key: 900.0 if value == "$right" else value for key, value in law["start"].items()}
    assert Wave.model_validate({"law": "wave"} | start)
    uploads = Uploads()
    try:
        held = state.as_state(spec_of(WAVE, constant(900.0)))
        text = state.as_toml(state.as_spec(held, uploads))
        assert 'law = "wave"' in text
        assert state.read_toml(text, uploads)[0] == held
    finally:
        uploads.close()


@pytest.mark.usefixtures("wave")
def test_the_reports_table_says_a_law_of_ones_own() -> None:
    mirror = mc.design(spec_of(WAVE, WAVE))
    rows = dict(facts(mirror, Metrics()))
    assert (rows["Horizontal law Rx(x)"], rows["Vertical law Ry(x)"]) == ("1 waves about 900 mm, 0.2 deep",) * 2


def test_no_file_of_the_packages_asks_for_a_law_by_name_but_the_laws_own() -> None:
    """A comparison or a match with a law's name, or with its class. Names of other things that are the same are known."""
    names = "|".join(mc.laws.registered())
    classes = "|".join(law.__name__ for law in mc.laws.registered().values())
    asks = re.compile(rf"""(?:[=!]==?\s*|\bin\s*[(\[{{][^)\]}}]*|\bcase\s+)["'](?:{names})["']"""
                      rf"""|\[[^\]]*["'](?:{names})["'][^\]]*\]\.includes"""
                      rf"""|isinstance\([^)]*\b(?:laws\.)?(?:{classes})\b|case (?:{classes})\(""")
    others = {"mirror_cad/laws/zones.py": "blend", "mirror_cad/laws/table.py": "interpolation",
              "mirror_studio/web/server.py": "kind ==", "mirror_cad/spec/target.py": "projection",
              "mirror_studio/web/js/grid.js": "projection"}
    found = []
    for path in (path for package in PACKAGES for path in (HOME / package).rglob("*") if path.suffix in (".py", ".js")):
        if path.name == "studio.js" or {"bench", "node_modules"} & set(path.parts):
            continue
        name = path.relative_to(HOME).as_posix()
        found += [f"{name}:{number}: {line.strip()}" for number, line in enumerate(path.read_text("utf-8").splitlines(), 1)
                  if asks.search(line) and others.get(name, "\0") not in line]
    assert found == []


def test_two_laws_cannot_have_one_name() -> None:
    class Other(Law):
        law: Literal["zones"] = "zones"

    class Nameless(Law):
        pass

    with pytest.raises(ValueError, match="'zones' is that of the law Zones"):
        mc.laws.register(Other)
    with pytest.raises(ValueError, match="has no name"):
        mc.laws.register(Nameless)
    assert mc.laws.registered()["zones"] is mc.laws.Zones


# --- what every law is ------------------------------------------------------------------------------------------------


LAWS = (
    mc.laws.Constant(radius_mm=-800), mc.laws.Linear(right_mm=1250, left_mm=400),
    mc.laws.Power(right_mm=1250, left_mm=400, exponent=2.5), mc.laws.Zones(right_mm=1250, left_mm=400, blend_from=0.5),
    mc.laws.Table(x_mm=[-100, 0, 50], radius_mm=[400, 900, 1250]),
    mc.laws.Table(x_mm=[-100, 0, 50], curvature_per_mm=[1e-3, 0, -1e-3], interpolation="monotone"),
    mc.laws.Expression(radius="900 + x"), mc.laws.Expression(curvature="1e-3*cos(t)"),
)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.law)
@given(factor=st.floats(0.5, 2.0))
def test_scaled_radii_are_radii_times_the_factor(law: Law, factor: float) -> None:
    x = np.linspace(-115.0, 115.0, 101)
    np.testing.assert_allclose(law.scaled(factor).over(SPAN).function(x) * factor, law.over(SPAN).function(x), rtol=1e-13,
                               atol=1e-18)  # near κ = 0, rounding of the largest, 1e-3 per mm


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.law)
def test_a_laws_repr_makes_it_again_and_its_keys_survive_json(law: Law) -> None:
    assert eval(repr(law), {type(law).__name__: type(law), "inf": math.inf}) == law
    assert mc.laws.registered()[law.law].model_validate(json.loads(json.dumps(law.model_dump(exclude_none=True)))) == law


def test_what_was_solved_for_takes_the_place_of_match() -> None:
    law = mc.laws.Zones(right_mm=1250, left_mm=400, blend_from="match", match=mc.laws.Match(sphere_mm=950))
    assert with_solved(law, ("blend_from", 0.5)) == mc.laws.Zones(right_mm=1250, left_mm=400, blend_from=0.5)
    assert with_solved(law, None) is law
    assert "0.5865 (solved for)" in law.in_words(0.58653)


# --- in Python --------------------------------------------------------------------------------------------------------


def test_a_mirror_is_scripted_in_four_lines_and_is_the_one_that_a_file_gives() -> None:
    spec = mc.MirrorSpec(horizontal=mc.laws.Zones(right_mm=1250, left_mm=400, blend_from=0.59),
                         vertical=mc.laws.Linear(right_mm=1250, left_mm=1350))
    mirror = mc.design(spec)
    read = mc.design(spec_of({"law": "zones", "right_mm": 1250.0, "left_mm": 400.0, "blend_from": 0.59},
                             {"law": "linear", "right_mm": 1250.0, "left_mm": 1350.0}))
    assert (mirror.surface.poles == read.surface.poles).all()
    assert repr(spec) == ("MirrorSpec(horizontal=Zones(right_mm=1250.0, left_mm=400.0, blend_from=0.59), "
                          "vertical=Linear(right_mm=1250.0, left_mm=1350.0))")
    for text in (repr(mirror), mirror._repr_html_()):
        assert "1250 mm at the right, 400 mm at the left, smooth blend from t = 0.59 to 1" in text
        assert "44.77°" in text
    assert len(repr(mirror)) < 400


def test_laws_are_reached_from_the_package_without_kernel_or_numba() -> None:
    program = ("import sys, mirror_cad as mc\nassert 'pydantic' not in sys.modules\n"
               "mc.MirrorSpec(horizontal=mc.laws.Constant(radius_mm=900), vertical=mc.laws.Constant(radius_mm=900))\n"
               "assert not {'OCP', 'numba', 'scipy'} & set(sys.modules)\n")
    subprocess.run([sys.executable, "-c", program], check=True, capture_output=True)


@pytest.mark.parametrize(("make", "said"), [
    (lambda: mc.laws.Zones(right_mm=1250, lefft_mm=400, blend_from=0.5),
     "Zones: lefft_mm: unknown key; did you mean 'left_mm'?"),
    (lambda: mc.laws.Constant(radius_mm=1e-320), "Constant: radius_mm = 1e-320: must be at least 1 mm in size"),
    (lambda: mc.laws.Constant(radius_mm=10**400), "Constant: radius_mm: a whole number of about 401 digits"),
    (lambda: mc.laws.Constant(radius_mm=True), "Constant: radius_mm = True: must be a number"),
    (lambda: mc.MirrorSpec(horizontal=mc.laws.Constant(radius_mm=900),
                           vertical=mc.laws.Constant(radius_mm=900, level_at="left")),
     "MirrorSpec: vertical.level_at: this key belongs to [horizontal]"),
    (lambda: mc.MirrorSpec(horizontal=mc.laws.Constant(radius_mm=900), vertical=mc.laws.Zones(
        right_mm=900, left_mm=800, blend_from="match", match=mc.laws.Match(sphere_mm=950))),
     "MirrorSpec: vertical.match: this key belongs to [horizontal]"),
])
def test_what_is_wrong_in_python_is_said_as_of_a_file(make: object, said: str) -> None:
    assert callable(make)
    with pytest.raises(mc.SpecError) as caught:
        make()
    assert said in str(caught.value)


def test_keys_of_the_horizontal_section_are_refused_in_the_vertical_one_beside_its_other_faults() -> None:
    with pytest.raises(mc.SpecError) as caught:
        spec_of(constant(900.0), {"law": "zones", "right_mm": 0, "left_mm": 900.0, "blend_from": "match", "level_at": "left",
                                  "match": {"sphere_mm": 950.0}})
    text = str(caught.value)
    for part in ("vertical.right_mm = 0: must be", "vertical.level_at: this key belongs to [horizontal]",
                 "vertical.match: this key belongs to [horizontal]",
                 'vertical.blend_from = "match": must be a number at least 0 and at most 1 (only [horizontal] is solved for)'):
        assert part in text
    assert len(caught.value.faults) == 4
    with pytest.raises(mc.SpecError, match=r"vertical\.match: this key belongs to \[horizontal\]"):
        spec_of(constant(900.0), constant(900.0) | {"match": {"sphere_mm": 950.0}})
    with pytest.raises(mc.SpecError, match=r"horizontal\.match: this key belongs to law = 'power' or 'zones'"):
        spec_of(constant(900.0) | {"match": {"sphere_mm": 950.0}}, constant(900.0))


@pytest.mark.parametrize("column", ["radius_mm", "curvature_per_mm"])
def test_lists_arrays_and_whole_numbers_make_the_same_table(column: str) -> None:
    value = 900 if column == "radius_mm" else 0
    tables = [mc.laws.Table.model_validate({"law": "table", "x_mm": x, column: y}) for x, y in (
        ([0, 1, 2], [value] * 3), ((0.0, 1.0, 2.0), (float(value),) * 3), (np.arange(3), np.full(3, value)),
        (np.arange(3, dtype=np.float32), np.full(3, value, dtype=np.float32)))]
    assert all(table == tables[0] for table in tables)


# --- a surface at (x, y) ----------------------------------------------------------------------------------------------


def test_surface_at_x_and_y_is_the_surface_at_its_parameters() -> None:
    surface = mc.design(mc.load_spec("progressive-c")).surface
    x, y = np.linspace(-100.0, 100.0, 7), np.linspace(-120.0, 120.0, 5)[:, None]
    np.testing.assert_allclose(surface.sag(x, y), surface.evaluate(x, y)[..., 2], rtol=0, atol=1e-13)
    d = surface.derivatives(x, y)
    cross = np.cross(d["u"], d["v"])
    np.testing.assert_allclose(surface.normal(x, y), cross / np.linalg.norm(cross, axis=-1, keepdims=True), atol=1e-12)
    k = surface.principal_curvatures(x, y)
    assert (surface.sag(x, y).shape, surface.normal(x, y).shape, k.shape) == ((5, 7), (5, 7, 3), (5, 7, 2))
    assert (k[..., 0] >= k[..., 1]).all()
    assert surface.sag(0, 0).shape == ()


def test_sag_normal_and_curvatures_of_a_sphere() -> None:
    """R = 1000 mm about (0, 0, −R). What is built is the decoupled surface of two equal laws, a sphere to 0.03 % near its
    middle: along y = 0 the sag is the circle's to the fit's 1e-5 mm."""
    surface = mc.design(mc.MirrorSpec(horizontal=mc.laws.Constant(radius_mm=1000),
                                      vertical=mc.laws.Constant(radius_mm=1000))).surface
    x = np.linspace(-110.0, 110.0, 23)
    np.testing.assert_allclose(surface.sag(x, 0.0), np.sqrt(1000.0**2 - x**2) - 1000.0, atol=1e-5)
    np.testing.assert_allclose(surface.normal(x, 0.0), np.stack([x, 0 * x, np.sqrt(1e6 - x**2)], axis=-1) / 1000.0, atol=1e-6)
    np.testing.assert_allclose(surface.principal_curvatures(0.0, 0.0), [1e-3, 1e-3], rtol=1e-4)


def test_a_surface_whose_parameters_are_not_x_and_y_says_so() -> None:
    from dataclasses import replace

    surface = mc.design(mc.load_spec("sphere-950")).surface
    assert surface.is_height_field
    turned = replace(surface, poles=surface.poles[..., [1, 0, 2]].copy())
    rational = replace(surface, weights=np.full(surface.poles.shape[:2], 2.0))
    stretched = replace(surface, poles=surface.poles * np.array([1.0 + 1e-9, 1.0, 1.0]))
    for other in (turned, rational, stretched):
        for method in (other.sag, other.normal, other.principal_curvatures):
            with pytest.raises(mc.SurfaceError, match="no height field over its parameters"):
                method(0.0, 0.0)
    with pytest.raises(mc.SurfaceError, match="no point at"):
        surface.sag(500.0, 0.0)


# --- tables -----------------------------------------------------------------------------------------------------------


ROWS = ((-115.0, 1250.0), (0.0, 950.5), (115.0, 400.0))
FILES = {
    "commas": "x_mm,radius_mm\n-115,1250\n0,950.5\n115,400\n",
    "semicolons, decimal commas": "x_mm;radius_mm\n-115;1250\n0;950,5\n115;400\n",
    "semicolons, decimal points": "x_mm;radius_mm\n-115;1250\n0;950.5\n115;400\n",
    "tabs, decimal commas": "x_mm\tradius_mm\n-115,0\t1250\n0\t950,5\n115\t400\n",
    "a spreadsheet's empty rows": "x_mm,radius_mm\n-115,1250\n\n0,950.5\n115,400\n,\n,\n",
    "a spreadsheet's first line": "sep=;\nx_mm;radius_mm\n-115;1250\n0;950,5\n115;400\n",
    "comments": "# of the drawing; R, in mm\nx_mm,radius_mm\n-115,1250\n# middle\n0,950.5\n115,400\n",
    "further columns": "row;R [mm];x [mm];remark\n1;1250;-115;edge\n2;950,5;0;\"middle; high\"\n3;400;115;\n",
    "metres": "x [m],R [m]\n-0.115,1.25\n0,0.9505\n0.115,0.4\n",
    "words and brackets": "X (mm)\tRadius of curvature (mm)\n-115\t1250\n0\t950.5\n115\t400\n",
    "slashes": "x / mm;Rx / mm\n-115;1250\n0;950,5\n115;400\n",
    "true minus signs": "x in mm;R in mm\n−115;1250\n0;950,5\n115;400\n",
    "Windows line ends and quotes": '"x_mm","radius_mm"\r\n"-115","1250"\r\n"0","950.5"\r\n"115","400"\r\n',
}


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "cp1252"])
@pytest.mark.parametrize("kind", FILES)
def test_tables_are_read_as_spreadsheets_write_them(kind: str, encoding: str, tmp_path: Path) -> None:
    text = FILES[kind]
    if encoding == "cp1252":
        text = text.replace("−", "–")  # what it has of a minus
    (tmp_path / "law.csv").write_bytes(text.encode(encoding))
    table = mc.laws.Table(file=str(tmp_path / "law.csv"))
    assert table.radius_mm is not None
    np.testing.assert_allclose(np.column_stack([table.x_mm, table.radius_mm]), ROWS, rtol=1e-15)


@pytest.mark.parametrize(("header", "scale"), [
    ("curvature_per_mm", 1.0), ("curvature [1/mm]", 1.0), ("kappa (1/m)", 1e-3), ("κ [1/m]", 1e-3), ("k [m^-1]", 1e-3),
    ("curvature / (1/mm)", 1.0), ("k in 1/m", 1e-3), ("kx_per_m", 1e-3), ("curvature mm⁻¹", 1.0)])
def test_curvature_columns_are_read_in_their_units(header: str, scale: float, tmp_path: Path) -> None:
    (tmp_path / "law.csv").write_text(f"x_mm;{header}\n0;0,8\n10;-0,5\n", encoding="utf-8")
    table = mc.laws.Table(file=str(tmp_path / "law.csv"))
    assert table.curvature_per_mm == pytest.approx([0.8 * scale, -0.5 * scale], rel=1e-15)


@pytest.mark.parametrize(("text", "said"), [
    ("x_mm|radius_mm\n0|900\n", "between commas, semicolons or tabs; it starts with x_mm|radius_mm"),
    ("x,radius\n0,900\n1,800\n", "or the same with other units"),
    ("x_mm,radius_mm\n-115,5,1250,0\n115,5,400,0\n", "line 2: '-115,5,1250,0' has 4 entries under 2 columns: if these are"),
    ("x_mm;radius_mm\n0;1.250,5\n1;900\n", "a comma in '1.250,5' (line 2) and a point in '1.250,5' (line 2)"),
    ("x_mm;radius_mm\n0;1.250\n1;900,5\n", "a comma in '900,5' (line 3) and a point in '1.250' (line 2)"),
    ("x_mm,radius_mm\n0,900\n1,\n", "line 3: '' in '1,' is no number"),
    ("x_mm,radius_mm\n0,900\n1,1_000\n", "line 3: '1_000'"),
    ("x_mm,Rx_mm,Ry_mm\n0,900,800\n", "3 columns that may be meant"),
    ("x_mm,radius_mm\n0,1e-320\n1,900\n", "radius_mm.0 = 1e-320: must be at least 1 mm"),
    ("x_mm,radius_mm\n0,nan\n1,900\n", "radius_mm.0 = nan: must be a number of mm"),
])
def test_a_table_that_cannot_be_read_says_why(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "law.csv").write_text(text)
    with pytest.raises(mc.SpecError) as caught:
        mc.laws.Table(file=str(tmp_path / "law.csv"))
    assert said in str(caught.value)


@pytest.mark.parametrize("data", [b"", b"\x00\x01\x02\x03", bytes(range(256)), b"\xff\xfe\x00", b"x_mm,radius_mm\n0,\x00\n"])
def test_what_is_no_text_is_refused(data: bytes, tmp_path: Path) -> None:
    (tmp_path / "law.csv").write_bytes(data)
    with pytest.raises(mc.SpecError, match=r"law\.csv"):
        mc.laws.Table(file=str(tmp_path / "law.csv"))


STEPPED = {"x_mm": (-115.0, -69.0, -23.0, 23.0, 69.0, 115.0), "radius_mm": (3000.0,) * 3 + (200.0,) * 3}


def test_a_table_that_overshoots_its_rows_says_where_and_by_how_much() -> None:
    """The extremes against a million samples of the independent not-a-knot spline in `make_interp_spline`."""
    from scipy.interpolate import make_interp_spline

    table = mc.laws.Table(**STEPPED)
    (remark,) = table.remarks(-115.0, 115.0)
    x = np.linspace(-115.0, 115.0, 1_000_001)
    kappa = make_interp_spline(table.x_mm, 1.0 / np.array(table.radius_mm), k=3)(x)
    assert (1.0 / kappa.max(), 1.0 / kappa.min()) == (pytest.approx(178.6, abs=0.05), pytest.approx(-3768.0, abs=0.5))
    assert f"R = 178.6 mm at x = {x[kappa.argmax()]:.1f} mm" in remark
    assert f"concave, R = −3768 mm at x = {x[kappa.argmin()]:.1f} mm" in remark
    notes = mc.design(mc.MirrorSpec(horizontal=table, vertical=mc.laws.Constant(radius_mm=1250))).notes
    assert notes == (f"the horizontal law {remark}",)


@pytest.mark.parametrize(("interpolation", "continuous"), [("monotone", 1), ("linear", 0)])
def test_other_tables_stay_within_their_rows(interpolation: Literal["monotone", "linear"], continuous: int) -> None:
    table = mc.laws.Table(**STEPPED, interpolation=interpolation)
    mirror = mc.design(mc.MirrorSpec(horizontal=table, vertical=mc.laws.Constant(radius_mm=1250)))
    x = np.linspace(-115.0, 115.0, 100_001)
    radius = 1.0 / mirror.curvature.horizontal(x)
    assert 200.0 - 1e-9 <= radius.min() <= radius.max() <= 3000.0 + 1e-9
    assert mirror.notes == ()
    assert mirror.fit.met
    assert {b.smoothness for b in table.over(SPAN).breaks[1:-1]} == {continuous}
    if interpolation == "linear":
        np.testing.assert_allclose(1.0 / radius, np.interp(x, table.x_mm, 1.0 / np.array(table.radius_mm)), rtol=1e-13)


@given(st.lists(st.floats(200.0, 3000.0), min_size=3, max_size=12), st.sampled_from([1.0, -1.0]))
def test_what_a_smooth_table_says_of_itself_is_what_dense_samples_show(radii: list[float], sign: float) -> None:
    x = np.linspace(-115.0, 115.0, len(radii))
    table = mc.laws.Table(x_mm=tuple(x.tolist()), radius_mm=tuple(sign * radius for radius in radii))
    rows = 1.0 / (sign * np.array(radii))
    kappa = table.over(SPAN).function(np.linspace(-115.0, 115.0, 20_001))
    past = max((kappa.max() - rows.max()) / abs(rows.max()), (rows.min() - kappa.min()) / abs(rows.min()))
    said = table.remarks(-115.0, 115.0)
    if past > 0.0101 or past < 0.0099:
        assert bool(said) == (past > 0.01)
    turned = kappa.min() < 0.0 if sign > 0 else kappa.max() > 0.0
    if turned and past > 0.0101:
        assert ("concave, " if sign > 0 else "convex, ") in said[0]


@pytest.mark.parametrize(("ends", "share"), [((-50.0, 50.0), "43.5"), ((-115.0, 0.0), "50"), ((-115.0, 114.0), "99.6")])
def test_a_table_that_covers_part_of_the_mirror_says_how_much(ends: tuple[float, float], share: str) -> None:
    table = mc.laws.Table(x_mm=ends, radius_mm=(1250, 400))
    (remark,) = table.remarks(-115.0, 115.0)
    assert f"covers {share} % of the mirror's width (-115 to 115 mm)" in remark
    assert mc.laws.Table(x_mm=(-115.0004, 114.9996), radius_mm=(1250, 400)).remarks(-115.0, 115.0) == []


@pytest.mark.parametrize("ends", [(115.0, 300.0), (-300.0, -115.0), (0.4, 0.6), (115.0, 115.1)])
def test_a_law_that_only_touches_the_mirror_runs_beside_it(ends: tuple[float, float]) -> None:
    """0.4 to 0.6, in metres or inches, is inside: what a law over a part of the mirror may mean."""
    for law in (mc.laws.Linear(right_mm=1250, left_mm=400, span_mm=ends), mc.laws.Table(x_mm=ends, radius_mm=(1250, 400))):
        remarks = law.remarks(-115.0, 115.0)
        assert any("beside the mirror" in remark for remark in remarks) == (abs(ends[0] + ends[1]) > 200.0)
    rows = mc.laws.Table(x_mm=(200.0, 250.0, 300.0), radius_mm=(1250, 900, 400))
    assert "from x = 200 to 300 mm" in rows.remarks(-115.0, 115.0)[0]


def test_many_rows_are_taken_only_smoothly() -> None:
    x = np.linspace(-115.0, 115.0, 201)
    assert mc.laws.Table(x_mm=tuple(x), radius_mm=(900.0,) * 201)
    with pytest.raises(mc.SpecError, match="takes up to 200 rows, this table has 201"):
        mc.laws.Table(x_mm=tuple(x), radius_mm=(900.0,) * 201, interpolation="linear")


# --- a law without a value somewhere ----------------------------------------------------------------------------------


TURN = 1.0 / 115.0  # κ at which the profile of a mirror 230 mm wide just turns vertical at its edges
FLATTER = mc.laws.Constant(radius_mm=1250)


@pytest.mark.parametrize("law", [
    mc.laws.Expression(curvature="0.00001*x"), mc.laws.Expression(curvature="max(0, 0.00001*x)"),
    mc.laws.Expression(curvature="1e-7*x**2"), mc.laws.Expression(curvature="1e-320 + 0*x"),
    mc.laws.Expression(curvature="1/x"), mc.laws.Expression(radius="0*x"), mc.laws.Expression(curvature="log(x)"),
    mc.laws.Constant(radius_mm=math.inf), mc.laws.Constant(radius_mm=115), mc.laws.Constant(radius_mm=115 + 1e-9),
    mc.laws.Constant(radius_mm=118), mc.laws.Constant(radius_mm=1e308), mc.laws.Linear(right_mm=1e200, left_mm=1250),
    mc.laws.Power(right_mm=1e308, left_mm=1250, exponent=1e-9), mc.laws.Expression(curvature=f"{2.0 * TURN / 115.0!r}*x"),
    mc.laws.Zones(right_mm=110, left_mm=111, blend_from="match", match=mc.laws.Match(h_fov_deg=170)),
    mc.laws.Table(x_mm=[-115, 0, 115], radius_mm=[1250, math.inf, -1250]),
], ids=repr)
@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_laws_that_are_flat_at_a_point_or_turn_vertical_end_in_a_mirror_or_in_words(law: Law) -> None:
    for horizontal, vertical in ((law, FLATTER), (FLATTER, law)):
        if horizontal is FLATTER and isinstance(law, Matched) and law.open:
            continue
        try:
            mirror = mc.design(mc.MirrorSpec(horizontal=horizontal, vertical=vertical))
        except mc.MirrorError as error:
            assert "nan" not in str(error)
            continue
        assert np.isfinite(mirror.surface.poles).all()
        assert repr(mirror)
