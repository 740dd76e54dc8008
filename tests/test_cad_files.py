"""CAD files as people have them: damaged, in parts, offset, tessellated, as IGES and BREP."""

from __future__ import annotations

import copy
import re
import shutil
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import raytrace
from mirror_cad.cad_file import read_cad
from mirror_cad.errors import FileError, MirrorError
from mirror_cad.part21_check import faults_of
from raytrace.surfaces.mesh import MeshSurface
from raytrace.surfaces.quadric import QuadricFace
from tests.conftest import designed
from tests.mutated import SORTS, mutated

FILES = Path(__file__).parent / "files"
CRASHES = (FILES / "crash-b-26.step", FILES / "crash-b-40.step")
DOWN = np.array([0.0, 0.0, -1.0])


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The text of a mirror's own file."""
    path = tmp_path_factory.mktemp("good") / "mirror.step"
    designed("progressive-c").export_step(path)
    return path.read_text("ascii")


def hits(reflector: raytrace.Reflector, x: Any, y: Any, z: float = 500.0) -> Any:
    """Where rays straight down meet it."""
    x, y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
    start = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, z)])
    return raytrace.reflect(reflector, start, np.tile(DOWN, (x.size, 1)))


# --- damage -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("path", CRASHES, ids=lambda path: path.stem)
def test_the_statement_at_fault_is_named(path: Path) -> None:
    """#294 is a curve whose list of points was torn: the kernel falls over it."""
    with pytest.raises(FileError, match="damaged: #294: "):
        raytrace.load_reflector(path)


@pytest.mark.parametrize("path", CRASHES, ids=lambda path: path.stem)
def test_the_kernels_fall_is_an_error_and_harms_nothing_else(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without our own look at the text, which would refuse them first: the kernel ends its process on both."""
    monkeypatch.setattr("mirror_cad.cad_file.faults_of", lambda text: [])
    with pytest.raises(FileError, match="SIGSEGV"):
        raytrace.load_reflector(path)
    assert len(read_cad(FILES / "tessellated-plate.step").faces) == 6  # by a new process


@pytest.mark.parametrize(("torn", "says"), [
    (lambda text: text.replace("#2 = ", "#200000 = ", 1), None),  # rests nothing on it: no business of ours
    (lambda text: _without(text, "VERTEX_POINT"), r"\(EDGE_CURVE\): it names #\d+, which the file does not hold"),
    (lambda text: _without(text, "B_SPLINE_SURFACE_WITH_KNOTS"), r"\(ADVANCED_FACE\): it names #\d+, which"),
    (lambda text: text[:len(text) // 2].rsplit(";", 1)[0] + ";", "cut short after #"),
    (lambda text: text.replace("DATA;", "", 1), "no DATA section"),
    (lambda text: re.sub(r"(VERTEX_POINT\('',)#\d+", rf"\1#{_number(text, 'DIRECTION')}", text, count=1),
     r"\(VERTEX_POINT\): it names #\d+, a DIRECTION, for a CARTESIAN_POINT"),
    (lambda text: _changed(text, "DIRECTION", ",0.", ""), "three coordinates|are not those of DIRECTION"),
    (lambda text: _changed(text, "B_SPLINE_CURVE_WITH_KNOTS", ".F.,.F.", ".F."), "not those of B_SPLINE_CURVE_WITH_KNOTS"),
    (lambda text: _changed(text, "B_SPLINE_SURFACE_WITH_KNOTS", "',", "',1"), "points in u at degree 1|not those of"),
    (lambda text: _changed(text, "ADVANCED_FACE", ");", ""), "is not ended by a semicolon"),
    (lambda text: _changed(text, "ADVANCED_FACE", "('", "('it''s ; #12=no statement "), None),
    (lambda text: text.replace("ENDSEC;\nEND-ISO", "/* #1=; */ENDSEC;\nEND-ISO"), None)])
def test_what_is_wrong_with_the_text_is_said_in_its_words(torn: Any, says: str | None, good: str) -> None:
    faults = faults_of(torn(good))
    if says is None:
        assert not faults
    else:
        assert faults
        assert re.search(says, faults[0]), faults


def _statement(text: str, name: str) -> tuple[int, int]:
    at = text.index(f"= {name}")
    return text.rindex("#", 0, at), text.index(";", at) + 1


def _number(text: str, name: str) -> str:
    return text[_statement(text, name)[0] + 1:].split()[0]


def _without(text: str, name: str) -> str:
    low, high = _statement(text, name)
    return text[:low] + text[high:]


def _changed(text: str, name: str, old: str, new: str) -> str:
    low, high = _statement(text, name)
    assert old in text[low:high]
    head = text[low:high].index("=")
    return text[:low + head] + text[low + head:high].replace(old, new, 1) + text[high:]


def test_a_face_that_the_kernel_leaves_out_in_silence_is_an_error(good: str, tmp_path: Path,
                                                                  monkeypatch: pytest.MonkeyPatch) -> None:
    """A pole without its third coordinate: the kernel drops the face, and its nine neighbours would reflect in its place."""
    monkeypatch.setattr("mirror_cad.cad_file.faults_of", lambda text: [])
    low, high = _statement(good, "B_SPLINE_SURFACE_WITH_KNOTS")
    pole = re.findall(r"#\d+", good[low:high])[1].removeprefix("#")
    at = good.index(f"#{pole} = CARTESIAN_POINT")
    end = good.index(";", at)
    path = tmp_path / "dropped.step"
    path.write_text(good[:at] + good[at:end].rsplit(",", 1)[0] + "))" + good[end:])
    with pytest.raises(FileError, match="cannot make its 'optical face'"):
        raytrace.load_reflector(path)


def test_a_face_left_out_of_a_part_that_is_placed_twice_is_missed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A block and its copy are twelve faces of six statements: the two that are lost with one plane are told as one."""
    from build123d import Box, Compound, Location, export_step

    block = Box(40, 40, 10)
    other = copy.copy(block)
    other.location = Location((100, 0, 0))
    path = tmp_path / "twice.step"
    export_step(Compound(label="both", children=[block, other]), str(path))
    whole, text = read_cad(path), path.read_text("ascii")
    assert (len(whole.faces), text.count("ADVANCED_FACE("), whole.lost) == (12, 6, ())
    monkeypatch.setattr("mirror_cad.cad_file.faults_of", lambda text: [])
    path.write_text(_without(text, "PLANE"))
    damaged = read_cad(path)
    assert (len(damaged.faces), len(damaged.lost)) == (10, 1)


def fuzzed(path: Path, text: str, seed: int) -> None:
    """One damaged file, read and traced: an answer without a NaN in it or an error of ours, within a minute."""
    sort, data = mutated(text, seed)
    path.write_bytes(data)
    start = time.monotonic()
    try:
        trace = hits(raytrace.load_reflector(path), np.linspace(-110.0, 110.0, 40), 10.0)
        assert np.isfinite(trace.points[trace.status == raytrace.Status.REFLECTED]).all(), (seed, sort)
    except MirrorError as error:
        assert path.name in str(error), (seed, sort, error)
    assert time.monotonic() - start < 60.0, (seed, sort)


@pytest.mark.parametrize("seed", range(len(SORTS)))
def test_damaged_files_end_in_an_answer_or_an_error(seed: int, good: str, tmp_path: Path) -> None:
    fuzzed(tmp_path / "damaged.step", good, seed)


@pytest.mark.long
@pytest.mark.parametrize("preset", ["progressive-c", "european-aspheric", "sphere-950"])
@pytest.mark.parametrize("checked", [True, False], ids=["text checked", "kernel alone"])
def test_hundreds_of_damaged_files(preset: str, checked: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each sort of damage ten times a preset; once more with nothing between the kernel and the file."""
    if not checked:
        monkeypatch.setattr("mirror_cad.cad_file.faults_of", lambda text: [])
    designed(preset).export_step(tmp_path / "mirror.step")
    text = (tmp_path / "mirror.step").read_text("ascii")
    for seed in range(100, 200):
        fuzzed(tmp_path / "damaged.step", text, seed)


@pytest.mark.long
def test_damaged_files_on_the_command_line(good: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Exit 0 or 2, with a message and without a traceback or a set half written."""
    from mirror_studio.cli import run

    for seed in range(200, 220):
        path, out = tmp_path / "damaged.step", tmp_path / f"out-{seed}"
        path.write_bytes(mutated(good, seed)[1])
        code = run(["trace", str(path), "--out", str(out), "--json"])
        said = capfd.readouterr()
        assert code in (0, 2), (seed, said.err)
        assert "Traceback" not in said.err
        assert out.exists() == (code == 0)
        assert said.out.startswith("{") if code == 0 else "mirror-cad: " in said.err


# --- names, parts, files beside ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def assembly(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cap of a sphere, a part named "mirror", before a box named "holder", as build123d writes them.

    By OCCT 7.9: a part that is one face gives that face its name, and a part of one solid has no product for the solid, which
    7.8 called "SOLID".
    """
    from build123d import Axis, Box, Color, Compound, Pos, Sphere, export_step

    glass = ((Pos(0, 0, -1250) * Sphere(1250)) & Box(200, 150, 40)).faces().sort_by(Axis.Z)[-1]
    glass.label, glass.color = "mirror", Color("red")
    holder = Pos(0, 0, -60) * Box(20, 20, 20)
    holder.label = "holder"
    path = tmp_path_factory.mktemp("assembly") / "assembly.step"
    export_step(Compound(label="assembly", children=[glass, holder]), str(path))
    return path


def test_a_parts_name_chooses_its_faces(assembly: Path) -> None:
    reflector = raytrace.load_reflector(assembly, "mirror")
    assert len(reflector.surface.bounding_faces) == 1
    x, y = 60.0, -40.0
    assert hits(reflector, x, y).points[0, 2] == pytest.approx(np.sqrt(1250.0**2 - x**2 - y**2) - 1250.0, abs=1e-9)
    assert len(raytrace.load_reflector(assembly, "holder").surface.bounding_faces) == 6
    assert len(raytrace.load_reflector(assembly, "assembly").surface.bounding_faces) == 7


def test_what_there_is_to_choose_from_is_said(assembly: Path) -> None:
    with pytest.raises(raytrace.TraceError, match="names: 'mirror'; parts: 'assembly', 'holder', 'mirror'; layers: none"):
        raytrace.load_reflector(assembly, "miror")


def test_a_layers_name_chooses_its_faces(tmp_path: Path) -> None:
    """Two blocks on layers of their own, as the kernel writes them."""
    from build123d import Box
    from OCP.BRepBuilderAPI import BRepBuilderAPI_Transform
    from OCP.gp import gp_Trsf, gp_Vec
    from OCP.STEPCAFControl import STEPCAFControl_Writer
    from OCP.TCollection import TCollection_ExtendedString
    from OCP.TDocStd import TDocStd_Document
    from OCP.XCAFDoc import XCAFDoc_DocumentTool

    document = TDocStd_Document(TCollection_ExtendedString("BinXCAF"))
    shapes = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    layers = XCAFDoc_DocumentTool.LayerTool_s(document.Main())
    # Moved itself, not only placed: of placed shapes the kernel writes no layer.
    move = gp_Trsf()
    move.SetTranslation(gp_Vec(100.0, 0.0, 0.0))
    moved = BRepBuilderAPI_Transform(Box(40, 40, 10).wrapped, move, True).Shape()
    for shape, layer in ((Box(40, 40, 10).wrapped, "bracket"), (moved, "glass")):
        layers.SetLayer(shapes.AddShape(shape, False), TCollection_ExtendedString(layer))
    writer = STEPCAFControl_Writer()
    writer.SetLayerMode(True)
    writer.Transfer(document)
    writer.Write(str(tmp_path / "layers.step"))
    assert [face.layers for face in read_cad(tmp_path / "layers.step").faces] == [("bracket",)] * 6 + [("glass",)] * 6
    assert raytrace.load_reflector(tmp_path / "layers.step", "glass").outline()[:, 0].min() == pytest.approx(80.0)


def test_a_face_has_its_own_colour_and_layer_before_its_parts(tmp_path: Path) -> None:
    """Every other face of a block has a colour and every third a layer, and the block has both."""
    from build123d import Box
    from OCP.Quantity import Quantity_Color, Quantity_TOC_sRGB
    from OCP.STEPCAFControl import STEPCAFControl_Writer
    from OCP.TCollection import TCollection_ExtendedString
    from OCP.TDocStd import TDocStd_Document
    from OCP.XCAFDoc import XCAFDoc_ColorGen, XCAFDoc_ColorSurf, XCAFDoc_DocumentTool

    from mirror_cad.occt.shapes import faces_of

    document = TDocStd_Document(TCollection_ExtendedString("BinXCAF"))
    shapes = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    colours, layers = XCAFDoc_DocumentTool.ColorTool_s(document.Main()), XCAFDoc_DocumentTool.LayerTool_s(document.Main())
    block = Box(40, 40, 10).wrapped
    part = shapes.AddShape(block, False)
    colours.SetColor(part, Quantity_Color(1.0, 1.0, 0.0, Quantity_TOC_sRGB), XCAFDoc_ColorGen)
    layers.SetLayer(part, TCollection_ExtendedString("block"))
    for k, face in enumerate(faces_of(block)):
        label = shapes.AddSubShape(part, face)
        if k % 2:
            colours.SetColor(label, Quantity_Color(0.0, 0.2 * k, 1.0, Quantity_TOC_sRGB), XCAFDoc_ColorSurf)
        if k % 3 == 0:
            layers.SetLayer(label, TCollection_ExtendedString(f"side {k}"))
    writer = STEPCAFControl_Writer()
    writer.SetColorMode(True)
    writer.SetLayerMode(True)
    writer.Transfer(document)
    writer.Write(str(tmp_path / "block.step"))
    found = read_cad(tmp_path / "block.step").faces
    assert [face.colour for face in found] == [(0, 51 * k, 255) if k % 2 else (255, 255, 0) for k in range(6)]
    assert [face.layers for face in found] == [(f"side {k}", "block") if k % 3 == 0 else ("block",) for k in range(6)]


def test_a_face_has_its_solids_colour_before_its_parts(tmp_path: Path) -> None:
    """One part of two blocks, of which each has a colour of its own, and so has the part."""
    from build123d import Box, Compound, Pos
    from OCP.Quantity import Quantity_Color, Quantity_TOC_sRGB
    from OCP.STEPCAFControl import STEPCAFControl_Writer
    from OCP.TCollection import TCollection_ExtendedString
    from OCP.TDocStd import TDocStd_Document
    from OCP.XCAFDoc import XCAFDoc_ColorGen, XCAFDoc_DocumentTool

    from mirror_cad.occt.shapes import solids_of

    document = TDocStd_Document(TCollection_ExtendedString("BinXCAF"))
    shapes = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    colours = XCAFDoc_DocumentTool.ColorTool_s(document.Main())
    both = Compound(children=[Box(40, 40, 10), Pos(100, 0, 0) * Box(40, 40, 10), Pos(200, 0, 0) * Box(40, 40, 10)]).wrapped
    part = shapes.AddShape(both, False)
    colours.SetColor(part, Quantity_Color(1.0, 1.0, 0.0, Quantity_TOC_sRGB), XCAFDoc_ColorGen)
    for solid, red in zip(solids_of(both)[:2], (0.2, 0.4), strict=True):
        colours.SetColor(shapes.AddSubShape(part, solid), Quantity_Color(red, 0.0, 1.0, Quantity_TOC_sRGB), XCAFDoc_ColorGen)
    writer = STEPCAFControl_Writer()
    writer.SetColorMode(True)
    writer.Transfer(document)
    writer.Write(str(tmp_path / "blocks.step"))
    found = [face.colour for face in read_cad(tmp_path / "blocks.step").faces]
    assert found == [(51, 0, 255)] * 6 + [(102, 0, 255)] * 6 + [(255, 255, 0)] * 6


def test_faces_are_listed_with_what_they_are_called(assembly: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import json

    from mirror_studio.cli import run

    assert run(["trace", str(assembly), "--faces", "--json"]) == 0
    faces = json.loads(capsys.readouterr().out)["faces"]
    assert [face["parts"] for face in faces] == [["assembly", "mirror"]] + [["assembly", "holder"]] * 6
    assert [face["surface"] for face in faces] == ["sphere"] + ["plane"] * 6
    assert faces[0]["colour"] == "#ff0000"
    assert [face["area_mm2"] for face in faces[1:]] == pytest.approx([400.0] * 6)
    # The cap over the rectangle a × b about its top: the integral of R/√(R² − x² − y²).
    x, y = np.polynomial.legendre.leggauss(40)
    cap = np.sum(np.outer(y, y) * 100.0 * 75.0 * 1250.0 / np.sqrt(1250.0**2 - (100 * x[:, None])**2 - (75 * x)**2))
    assert faces[0]["area_mm2"] == pytest.approx(cap, rel=1e-6)
    assert run(["trace", str(assembly), "--faces"]) == 0
    assert "assembly / mirror" in capsys.readouterr().out


def test_parts_in_other_files_are_named(tmp_path: Path) -> None:
    shutil.copy(FILES / "structure-only.step", tmp_path / "car.step")
    with pytest.raises(FileError, match=r"its parts are in other files: glass.step: trace those"):
        raytrace.load_reflector(tmp_path / "car.step")
    shutil.copy(FILES / "offset-cylinder.step", tmp_path / "glass.step")
    with pytest.raises(FileError, match=r"in other files, beside it: glass.step: trace those"):
        raytrace.load_reflector(tmp_path / "car.step")


def test_files_beside_an_assembly_are_followed(tmp_path: Path) -> None:
    """An assembly of two blocks, written by the kernel with each part in a file of its own."""
    from build123d import Box, Compound, Pos
    from OCP.STEPCAFControl import STEPCAFControl_Writer
    from OCP.STEPControl import STEPControl_AsIs
    from OCP.TCollection import TCollection_ExtendedString
    from OCP.TDocStd import TDocStd_Document
    from OCP.XCAFDoc import XCAFDoc_DocumentTool

    document = TDocStd_Document(TCollection_ExtendedString("BinXCAF"))
    both = Compound([Box(40, 40, 10), Pos(100, 0, 0) * Box(40, 40, 20)])
    XCAFDoc_DocumentTool.ShapeTool_s(document.Main()).AddShape(both.wrapped, True)
    writer = STEPCAFControl_Writer()
    writer.Transfer(document, STEPControl_AsIs, "part-")
    writer.Write(str(tmp_path / "whole.step"))
    parts = sorted(tmp_path.glob("part-*"))
    assert len(parts) == 2
    file = read_cad(tmp_path / "whole.step")
    assert (len(file.faces), file.missing) == (12, ())
    reflector = raytrace.load_reflector(tmp_path / "whole.step")
    assert hits(reflector, [0.0, 100.0], 5.0).points[:, 2] == pytest.approx([5.0, 10.0])
    parts[1].unlink()
    assert read_cad(tmp_path / "whole.step").missing == (parts[1].name,)
    with pytest.raises(raytrace.TraceError, match=f"not beside it \\({parts[1].name}\\)"):
        raytrace.load_reflector(tmp_path / "whole.step")


# --- surfaces ---------------------------------------------------------------------------------------------------------


def test_an_offset_cylinder_is_a_cylinder() -> None:
    """5 mm off one of R = 1250 mm about z through x = y = 0, from −0.1 to 0.1 rad: the kernel's conversion fails there."""
    reflector = raytrace.load_reflector(FILES / "offset-cylinder.step")
    assert isinstance(reflector.surface, QuadricFace)
    quadric = reflector.surface.quadric
    assert (quadric.kind, quadric.radius_mm) == ("cylinder", pytest.approx(1255.0, abs=1e-9))
    angle = np.linspace(-0.099, 0.099, 50)
    origins = np.column_stack([2000.0 * np.cos(angle), 2000.0 * np.sin(angle), np.full(50, 20.0)])
    trace = raytrace.reflect(reflector, origins, origins * [-1.0, -1.0, 0.0])
    assert np.hypot(trace.points[:, 0], trace.points[:, 1]) == pytest.approx(np.full(50, 1255.0), abs=1e-9)


def offset_face(kind: str, offset: float, u: tuple[float, float], v: tuple[float, float], path: Path) -> Any:
    """Write a face on an offset surface; returns it as the kernel has it."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace
    from OCP.Geom import (
        Geom_ConicalSurface,
        Geom_CylindricalSurface,
        Geom_OffsetSurface,
        Geom_Parabola,
        Geom_Plane,
        Geom_SphericalSurface,
        Geom_SurfaceOfRevolution,
        Geom_ToroidalSurface,
    )
    from OCP.gp import gp_Ax1, gp_Ax2, gp_Ax3, gp_Dir, gp_Pnt
    from OCP.STEPControl import STEPControl_AsIs, STEPControl_Writer

    from mirror_cad.occt.convert import to_geom_surface

    axes = gp_Ax3(gp_Pnt(3.0, -2.0, 1.0), gp_Dir(0.1, 0.2, 1.0))
    made = {
        "plane": lambda: Geom_Plane(axes), "cylinder": lambda: Geom_CylindricalSurface(axes, 80.0),
        "cone": lambda: Geom_ConicalSurface(axes, 0.3, 60.0), "sphere": lambda: Geom_SphericalSurface(axes, 90.0),
        "torus": lambda: Geom_ToroidalSurface(axes, 100.0, 30.0),
        "paraboloid": lambda: Geom_SurfaceOfRevolution(
            Geom_Parabola(gp_Ax2(gp_Pnt(0, 0, 0), gp_Dir(0, -1, 0), gp_Dir(0, 0, 1)), 300.0),
            gp_Ax1(gp_Pnt(0, 0, 0), gp_Dir(0, 0, 1))),
        "spline": lambda: to_geom_surface(designed("progressive-c").surface)}
    face = BRepBuilderAPI_MakeFace(Geom_OffsetSurface(made[kind](), offset), *u, *v, 1e-7).Face()
    writer = STEPControl_Writer()
    writer.Transfer(face, STEPControl_AsIs)
    writer.Write(str(path))
    return face


@pytest.mark.parametrize(("kind", "offset", "u", "v"), [
    ("plane", 5.0, (-40.0, 40.0), (-30.0, 30.0)), ("cylinder", -7.0, (-0.5, 1.0), (0.0, 50.0)),
    ("cylinder", 5.0, (0.0, 2 * np.pi), (-20.0, 50.0)),
    ("cone", 4.0, (-1.0, 2.0), (0.0, 60.0)), ("sphere", 5.0, (-0.2, 0.9), (-0.3, 0.7)),
    ("sphere", -6.0, (4.0, 7.0), (0.0, 1.2)),
    ("torus", 3.0, (-0.5, 2.0), (-1.0, 1.5)), ("paraboloid", 5.0, (1.2, 2.2), (60.0, 150.0)),
    ("spline", -3.0, (-90.0, 80.0), (-100.0, 120.0))])
def test_every_known_place_of_an_offset_surface_is_met(kind: str, offset: float, u: Any, v: Any, tmp_path: Path) -> None:
    """Rays along the normals at known parameters, a little inside the edges; what they meet is there to 1e-6 mm."""
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.gp import gp_Pnt, gp_Vec

    adaptor = BRepAdaptor_Surface(offset_face(kind, offset, u, v, tmp_path / "offset.step"), False)
    chance = np.random.default_rng(5)
    share = chance.uniform(0.01, 0.99, (200, 2))
    places, normals = [], []
    for a, b in share:
        point, along_u, along_v = gp_Pnt(), gp_Vec(), gp_Vec()
        adaptor.D1(u[0] + a * (u[1] - u[0]), v[0] + b * (v[1] - v[0]), point, along_u, along_v)
        places.append(point.Coord())
        normals.append(along_u.Crossed(along_v).Normalized().Coord())
    at, normal = np.array(places), np.array(normals)
    reflector = raytrace.load_reflector(tmp_path / "offset.step")
    trace = raytrace.reflect(reflector, at + 2.0 * normal, -normal)
    assert (trace.status == raytrace.Status.REFLECTED).all(), trace.counts()
    assert np.linalg.norm(trace.points - at, axis=1).max() < 1e-6
    assert np.abs(np.einsum("ij,ij->i", trace.normals, normal)).min() > 1.0 - 1e-12


def test_a_full_turn_whose_edges_the_kernel_loses_is_refused(tmp_path: Path) -> None:
    """The closed paraboloid, 5 mm off: its pcurves, which the kernel works out, leave the edges by 200 mm; two rays of three
    would be lost in silence."""
    offset_face("paraboloid", 5.0, (0.0, 2 * np.pi), (60.0, 150.0), tmp_path / "turn.step")
    with pytest.raises(MirrorError, match="edges of a face on an offset surface .* mm off the surface: export"):
        raytrace.load_reflector(tmp_path / "turn.step")


def test_triangles_of_ap242_are_a_mesh() -> None:
    """A box of 100 × 80 × 10 mm as TRIANGULATED_FACEs alone."""
    file = read_cad(FILES / "tessellated-plate.step", areas=True)
    assert [face.surface for face in file.faces] == ["triangles"] * 6
    assert sorted(face.area_mm2 or 0.0 for face in file.faces) == pytest.approx([800.0, 800.0, 1000.0, 1000.0, 8000.0, 8000.0])
    reflector = raytrace.load_reflector(FILES / "tessellated-plate.step")
    assert isinstance(reflector.surface, MeshSurface)
    low, high = reflector.surface.mesh.vertices.min(axis=0), reflector.surface.mesh.vertices.max(axis=0)
    assert sorted(high - low) == pytest.approx([10.0, 80.0, 100.0])
    x, y = 0.5 * (low + high)[:2] + [3.0, 4.0]
    assert hits(reflector, x, y).points[0] == pytest.approx([x, y, high[2]], abs=1e-9)


@pytest.mark.parametrize("ending", [".igs", ".iges", ".brep", ".brp"])
def test_iges_and_brep_show_what_step_shows(ending: str, assembly: Path, tmp_path: Path) -> None:
    """A cap of a sphere of 1250 mm, against the closed form."""
    from build123d import Axis, Box, Pos, Sphere, export_brep
    from OCP.IGESControl import IGESControl_Controller, IGESControl_Writer

    cap = ((Pos(0, 0, -1250) * Sphere(1250)) & Box(200, 150, 40)).faces().sort_by(Axis.Z)[-1]
    path = tmp_path / f"cap{ending}"
    if ending.startswith(".b"):
        export_brep(cap, str(path))
    else:
        IGESControl_Controller.Init_s()
        writer = IGESControl_Writer("MM", 1)  # faces as B-rep entities
        writer.AddShape(cap.wrapped)
        writer.Write(str(path))
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-90, 90, 9), np.linspace(-70, 70, 9)))
    trace = hits(raytrace.load_reflector(path), x, y)
    assert (trace.status == raytrace.Status.REFLECTED).all()
    assert trace.points[:, 2] == pytest.approx(np.sqrt(1250.0**2 - x**2 - y**2) - 1250.0, abs=1e-6)


@pytest.mark.parametrize(("name", "data", "says"), [
    ("a.igs", b"no IGES at all\n", "not an IGES file"), ("a.brep", b"no BREP", "not a BREP file"),
    ("a.brep", b"", "not a BREP file"), ("a.step", b"", "no DATA section"),
    ("a.step", bytes(range(256)) * 40, "no DATA section"),
    ("a.3dm", b"", "Open it in Rhino and save it as STEP"), ("a.dae", b"", "Open it in Blender and save it as PLY, OBJ or GLB"),
    ("a.sldprt", b"", "SolidWorks"), ("a.xyz", b"", "not from '.xyz'$")])
def test_other_files_are_refused_with_what_to_do(name: str, data: bytes, says: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(MirrorError, match=says):
        raytrace.load_reflector(tmp_path / name)


def test_a_file_in_inches_is_read_in_millimetres(tmp_path: Path) -> None:
    from build123d import Box, Unit, export_step

    export_step(Box(25.4, 50.8, 12.7), str(tmp_path / "inch.step"), unit=Unit.IN)
    top = raytrace.load_reflector(tmp_path / "inch.step").outline().max(axis=0)
    assert top == pytest.approx([12.7 * 25.4, 25.4 * 25.4, 6.35 * 25.4]) or top == pytest.approx([12.7, 25.4, 6.35])
