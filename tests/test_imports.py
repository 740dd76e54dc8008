"""The house's one direction: who may import whom, and what starts without the kernel."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

HOME = Path(__file__).resolve().parent.parent
KERNEL = {"OCP", "build123d", "cadquery"}
# The benchmark's peers: what they are compared with is the bare library.
PEERS = {HOME / "mirror_studio" / "bench" / "tracers" / name for name in ("raw_embree.py", "occt_shape.py")}


def imports_of(path: Path, types: bool = False) -> set[str]:
    """Every module a file imports, wherever in it; what stands under TYPE_CHECKING is not run and counts for types alone."""
    tree = ast.parse(path.read_text("utf-8"))
    for node in ast.walk(tree) if not types else ():
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            node.body = [ast.Pass()]
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module)
    return found


def files(package: str) -> list[Path]:
    return sorted((HOME / package).rglob("*.py"))


def module_of(path: Path) -> str:
    return ".".join(path.relative_to(HOME).with_suffix("").parts).removesuffix(".__init__")


def imported_modules(package: str, types: bool = False) -> dict[str, set[str]]:
    """Of each module of a package the others of it that it imports; `from raytrace.kernels import newton` is one of newton."""
    paths = {module_of(path): path for path in files(package)}
    found = {}
    for name, path in paths.items():
        whole = imports_of(path, types)
        tree = ast.parse(path.read_text("utf-8"))
        parts = {f"{node.module}.{alias.name}" for node in ast.walk(tree)
                 if isinstance(node, ast.ImportFrom) and node.module in whole for alias in node.names}
        found[name] = {each for each in parts | whole if each in paths} - {name}
    return found


# The floors of the tracer, from the ground: what stands on one uses what is below, and nothing above.
FLOORS = ("kernels", "surfaces", "viewing", "visibility", "measures")


def test_geometry_knows_neither_light_nor_people() -> None:
    """So that a mirror can be designed in any program without a tracer or a web page coming along."""
    for path in files("mirror_cad"):
        assert not {name for name in imports_of(path) if name.split(".")[0] in ("raytrace", "mirror_studio")}, path


def test_tracer_knows_no_design_intent() -> None:
    """So that any STEP face is traced as ours are: only plain records, errors, and in `load_reflector` the readers."""
    plain = {"mirror_cad.limits", "mirror_cad.cad_file", "mirror_cad.guarded",
             "mirror_cad.surfaces.basis", "mirror_cad.surfaces.bspline", "mirror_cad.surfaces.quadric",
             "mirror_cad.mesh", "mirror_cad.errors", "mirror_cad.eyes",
             "mirror_cad.surfaces.differential", "mirror_cad.surfaces.fit", "mirror_cad.vectors"}
    readers = {"mirror_cad.stl_file", "mirror_cad.own_files"}
    for path in files("raytrace"):
        used = {name for name in imports_of(path) if name.split(".")[0] in ("mirror_cad", "mirror_studio")}
        allowed = plain | readers if path.name == "load.py" else plain
        assert used <= allowed, (path, used - allowed)


def test_no_arrow_in_the_tracer_runs_back_up() -> None:
    """So that a surface can be read without knowing who looks at it, and a view without what is measured in it."""
    above = {"kernels": ("reflector", "trace", "scene", "image"), "surfaces": ("reflector", "trace", "scene", "image"),
             "viewing": ("scene", "image"), "visibility": ("scene", "image"), "measures": ()}
    for name, used in imported_modules("raytrace").items():
        floor = name.split(".")[1] if name.count(".") > 1 else ""
        if floor not in FLOORS:
            continue
        higher = {*FLOORS[FLOORS.index(floor) + 1:], *above[floor]}
        assert not {other for other in used if other.split(".")[1:2] and other.split(".")[1] in higher}, name


@pytest.mark.parametrize("types", [False, True])
@pytest.mark.parametrize("package", ["mirror_cad", "raytrace", "mirror_studio"])
def test_no_circle_of_imports(package: str, types: bool) -> None:
    """So that any module can be read, and loaded, before those that use it: those that it needs for its types alone, too."""
    graph = imported_modules(package, types)
    while graph:  # what imports nothing that is left is in no circle
        free = {name for name, used in graph.items() if not used & graph.keys()}
        assert free, sorted(graph)
        graph = {name: used for name, used in graph.items() if name not in free}


def test_only_surfaces_ask_what_kind_a_surface_is() -> None:
    """So that a new kind of surface is one file: what is asked of it stands in `OpticalSurface`."""
    kinds = {node.name for path in files("raytrace") if path.parent.name == "surfaces"
             for node in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(node, ast.ClassDef)}
    assert {"OpticalSurface", "BSplineFace", "QuadricFace", "FaceSet", "MeshSurface", "Plate"} <= kinds
    for path in files("raytrace") + files("mirror_studio"):
        if path.parent == HOME / "raytrace" / "surfaces":
            continue
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("isinstance", "issubclass"):
                asked = {name.id for name in ast.walk(node.args[1]) if isinstance(name, ast.Name)}
                assert not asked & kinds, (path, node.lineno)


def test_kernel_and_embree_have_one_door_each() -> None:
    """So that either can be replaced or mended in one place."""
    for path in files("mirror_cad") + files("raytrace") + files("mirror_studio"):
        if path in PEERS:
            continue
        roots = {name.split(".")[0] for name in imports_of(path)}
        if path.parent.name != "occt" and path != HOME / "mirror_cad" / "mirror.py":  # its to_build123d and to_cadquery
            assert not roots & KERNEL, path
        if path != HOME / "raytrace" / "embree.py":
            assert "embreex" not in roots, path


def test_nothing_imports_the_studio() -> None:
    for package in ("mirror_cad", "raytrace"):
        for path in files(package):
            assert not {name for name in imports_of(path) if name.startswith("mirror_studio")}, path


@pytest.mark.parametrize("code", ["import mirror_cad", "import raytrace",
                                  "import mirror_cad; mirror_cad.load_spec('sphere-950')",
                                  "from mirror_studio.cli import run; run(['--help'])"])
def test_no_kernel_vtk_or_numba_is_loaded_before_it_is_needed(code: str) -> None:
    heavy = {"OCP", "vtkmodules", "numba", "pyvista", "build123d", "cadquery"}
    program = f"{code}\nimport sys\nassert not {heavy!r} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", program], check=True, capture_output=True)


def test_help_is_quick() -> None:
    """0.3 s is the promise; of processor time and the best of five, since the machine is shared."""
    times = []
    for _ in range(5):
        before = os.times()
        subprocess.run([sys.executable, "-m", "mirror_studio", "--help"], check=True, capture_output=True)
        after = os.times()
        times.append(after.children_user + after.children_system - before.children_user - before.children_system)
    assert min(times) <= 0.3


def test_no_registry_address_in_a_lock_file() -> None:
    for name in ("requirements.lock", "requirements-test.lock", "pyproject.toml"):
        text = (HOME / name).read_text("utf-8")
        assert "://" not in text, name
        assert "index-url" not in text
    for name in ("requirements.lock", "requirements-test.lock"):
        requirements = [line for line in (HOME / name).read_text("utf-8").splitlines() if "==" in line]
        assert requirements
        assert (HOME / name).read_text("utf-8").count("--hash=sha256:") >= len(requirements)
