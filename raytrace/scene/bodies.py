"""A mesh file in, a body that can be placed in the driver's world out: triangles, materials, and how much sky they see."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mirror_cad.errors import FileError
from raytrace.embree import TriangleScene, extent
from raytrace.errors import SceneError
from raytrace.pictures import decoded
from raytrace.polygon_mesh import FARTHEST, misplaced
from raytrace.scene.gltf import read_gltf
from raytrace.scene.materials import Colour, Material
from raytrace.scene.parts import Joined, Part, joined
from raytrace.scene.visibility import Contact, contact, vertex_openness

Array = NDArray[np.float64]

GLTF_KINDS = (".glb", ".gltf")
KINDS = (*GLTF_KINDS, ".obj", ".ply", ".off", ".3mf", ".stl")
MM_PER_UNIT = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "inch": 25.4, "foot": 304.8}
Up = Literal["z", "y"]
# What stands beside a road: a smaller or larger body was most likely read in the wrong unit.
SMALLEST_MM, LARGEST_MM = 30.0, 5e6
MAX_TRIANGLES = 5_000_000  # some 2 GB; cars have 10⁴ to 10⁵
MAX_SHADED = 200_000  # vertices that the sky's share is computed for: some 10 s
HIDES_FROM = 0.5  # mean cover of a material from which it hides the sky, all of it
PAINT = "paint"  # the material whose colour a scene may choose
# y up and the front at +z, as glTF has it, to X rearward, Y right, Z up.
WORLD_FROM_Y_UP = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """Triangles in the world's frame, mm.

    vertices, normals (n, 3); uv (n, 2), NaN where there is none, v = 0 at a texture's first row; sky (n,): the
    cosine-weighted share of the half space above the vertex's normal that sees past the body, ground included.
    faces (m, 3) int32, counter-clockwise seen from outside; material (m,) int32, an index into `materials`.
    contact : its shadow from the sky on the ground, if any.   colours (n, 4) : linear RGB and cover of the vertices, 0 … 1,
    that the materials' are multiplied by.   left_out : a line that says what of its file's look is not drawn, "" for all.
    """

    vertices: Array
    normals: Array
    uv: Array
    sky: Array
    faces: NDArray[np.int32]
    material: NDArray[np.int32]
    materials: tuple[Material, ...]
    contact: Contact | None = None
    colours: Array | None = None
    left_out: str = ""

    def placed(self, position_mm: ArrayLike, heading_deg: float = 0.0) -> Body:
        """The body turned about Z and moved: at heading 0 it looks ahead (−X), at 90 to the right (+Y).

        A body that is not put on the ground loses its contact shadow.
        """
        position = np.array(position_mm, dtype=np.float64)
        if position.shape != (3,) or not np.isfinite(position).all() or not np.isfinite(heading_deg):
            raise SceneError(f"a body is placed at three finite numbers and a heading, not at {position.tolist()} and "
                             f"{heading_deg}")
        turn = np.radians(heading_deg)
        rotation = np.array([[np.cos(turn), np.sin(turn), 0.0], [-np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
        flat = rotation[:2, :2]
        shadow = None
        if self.contact is not None and position[2] == 0.0:
            shadow = replace(self.contact, origin=flat @ self.contact.origin + position[:2], along=flat @ self.contact.along,
                             across=flat @ self.contact.across)
        return replace(self, vertices=self.vertices @ rotation.T + position, normals=self.normals @ rotation.T, contact=shadow)

    def painted(self, colour: Colour) -> Body:
        """The body with another diffuse colour (linear sRGB) of the materials named PAINT.

        Raises
        ------
        SceneError
            For a body without one.
        """
        if not any(material.name == PAINT for material in self.materials):
            names = ", ".join(sorted({repr(material.name) for material in self.materials}))
            raise SceneError(f"no material is named {PAINT!r}: this body's are {names}")
        return replace(self, materials=tuple(replace(m, diffuse=colour) if m.name == PAINT else m for m in self.materials))


def read_body(path: str | Path, unit: str | None = None, up: Up = "z") -> Body:
    """A body from a glTF, GLB, OBJ, PLY, OFF, 3MF or STL file, at the origin.

    glTF is in metres with y up by its standard; a vehicle looks along +z there, which becomes ahead (−X). 3MF names its
    unit. The others have none: mm, or `unit` (mm, cm, m, inch, foot); with z up in the world's axes (X rearward, Y right),
    or, with `up` = "y", as glTF. How much sky vertices see is the file's attribute _SKY, or computed here for up to
    MAX_SHADED vertices; the contact shadow likewise, from `extras.ground` of a mesh: x0, dx, nx, y0, dy, ny in metres
    rearward from the origin and to the right, sky: nx·ny shares, x the slow index.

    Raises
    ------
    FileError
        For a file that is missing, broken, without triangles or with more than MAX_TRIANGLES, with corners that are not
        finite, or whose size says that its unit is another one.
    SceneError
        For another kind of file or unit.
    """
    path = Path(path)
    kind = path.suffix.lower()
    if kind not in KINDS:
        raise SceneError(f"{path}: a body is read from {', '.join(KINDS)}, not from {kind or 'a file without ending'!r}")
    if unit is not None and unit not in MM_PER_UNIT:
        raise SceneError(f"{path}: unit {unit!r} is none of {', '.join(MM_PER_UNIT)}")
    if not path.is_file():
        raise FileError(f"{path}: cannot be read: {'a folder, no file' if path.is_dir() else 'no such file'}")
    ground: dict[str, Any] | None = None
    if kind in GLTF_KINDS:
        if unit not in (None, "m"):
            raise SceneError(f"{path}: glTF is in metres by its standard, unit = {unit!r} is refused: scale the model")
        read = read_gltf(path, partial(decoded, as_stored=True))
        parts, ground, left_out = read.parts, read.ground, read.left_out
        scale, axes = 1000.0 * read.metres, WORLD_FROM_Y_UP
    else:
        from raytrace.mesh_files import read_parts

        parts, named, left_out = read_parts(path, MAX_TRIANGLES, decoded)
        scale = MM_PER_UNIT[unit] if unit is not None else (named or 1.0)
        axes = WORLD_FROM_Y_UP if up == "y" else np.eye(3)
    parts = _checked(path, parts)
    _refuse_size(path, parts, scale, kind in GLTF_KINDS)
    whole = joined(parts)
    if len(whole.faces) == 0:
        raise FileError(f"{path}: none of its triangles has an area")
    vertices = scale * whole.vertices @ axes.T
    body = _shaded(whole._replace(vertices=vertices, normals=whole.normals @ axes.T),
                   None if ground is None else _contact(path, ground))
    return replace(body, left_out=f"{path.name}: left out: {', '.join(left_out)}" if left_out else "")


def body_of(vertices: ArrayLike, faces: ArrayLike, material: Material, normals: ArrayLike | None = None,
            uv: ArrayLike | None = None, sky: ArrayLike | None = None) -> Body:
    """A body of one material from arrays in the world's frame, mm; what is left out is made as `read_body` does."""
    part = Part(np.array(vertices, dtype=np.float64), np.array(faces, dtype=np.int64), material,
                *(None if values is None else np.array(values, dtype=np.float64) for values in (normals, uv, sky)))
    return _shaded(joined([part]), None)


def _shaded(whole: Joined, shadow: Contact | None) -> Body:
    """The body, with the sky's share and the shadow where they are missing.

    What covers half or more of what is behind it hides the sky.
    """
    sky, missing = whole.sky, np.isnan(whole.sky)
    scene = _hiding(whole) if shadow is None or missing.any() else None  # of bodies that bring both, Embree need not know
    if missing.any():
        few = np.count_nonzero(missing) <= MAX_SHADED
        sky = np.where(missing, 1.0 if scene is None or not few else
                       vertex_openness(scene, whole.vertices, whole.normals, whole.faces), sky)
    if shadow is None and scene is not None:
        shadow = contact(scene, whole.vertices)
    return Body(whole.vertices, whole.normals, whole.uv, np.clip(sky, 0.0, 1.0), whole.faces, whole.material, whole.materials,
                shadow, whole.colours)


def _hiding(whole: Joined) -> TriangleScene | None:
    """The triangles that hide the sky; None where there are none."""
    hides = np.array([material.mean_cover >= HIDES_FROM for material in whole.materials])[whole.material]
    return TriangleScene(whole.vertices, whole.faces[hides]) if hides.any() else None


def _checked(path: Path, parts: list[Part]) -> list[Part]:
    """The parts that have triangles, or FileError."""
    parts = [part for part in parts if len(part.faces)]
    if not parts:
        raise FileError(f"{path}: holds no triangles")
    count = sum(len(part.faces) for part in parts)
    if count > MAX_TRIANGLES:
        raise FileError(f"{path}: {count} triangles are more than {MAX_TRIANGLES}: reduce the mesh")
    for part in parts:
        if part.faces.min() < 0 or part.faces.max() >= len(part.vertices):
            raise FileError(f"{path}: a triangle names vertex {int(part.faces.max())} of {len(part.vertices)}")
        wrong = misplaced(part.vertices)[part.faces].any(axis=1)
        if wrong.any():
            raise FileError(f"{path}: triangle {int(np.argmax(wrong))} has a corner that is not finite, or beyond {FARTHEST:g}")
        for name, values in (("normal", part.normals), ("sky share", part.sky), ("colour", part.colours)):
            if values is not None and not np.isfinite(values).all() and not np.isfinite(values[np.unique(part.faces)]).all():
                raise FileError(f"{path}: a vertex has a {name} that is not finite")
    return parts


def _refuse_size(path: Path, parts: list[Part], scale: float, metres: bool) -> None:
    """Refuse what is no size of a thing beside a road, with a guess at the unit that was meant."""
    boxes = [extent(part.vertices[part.faces].reshape(-1, 3)) for part in parts]  # what no triangle names is not drawn
    low, high = np.min([low for low, _ in boxes], axis=0), np.max([high for _, high in boxes], axis=0)
    size = float((high - low).max()) * scale
    if SMALLEST_MM <= size <= LARGEST_MM:
        return
    if metres:
        advice = "glTF is in metres: was it written in mm?" if size > LARGEST_MM else "glTF is in metres: scale the model"
    elif size < SMALLEST_MM:
        advice = "is it in metres? unit = \"m\""
    else:
        advice = "is it in a smaller unit? unit = \"mm\"" if scale > 1.0 else "is it placed far from its origin, or in µm?"
    raise FileError(f"{path}: it is {size:g} mm across, a body has {SMALLEST_MM:g} mm to {LARGEST_MM / 1e6:g} km: {advice}")


def _contact(path: Path, ground: dict[str, Any]) -> Contact:
    try:
        x0, dx, y0, dy = (1000.0 * float(ground[name]) for name in ("x0", "dx", "y0", "dy"))
        sky = np.array(ground["sky"], dtype=np.float64).reshape(int(ground["nx"]), int(ground["ny"]))
    except (KeyError, TypeError, ValueError) as error:
        raise FileError(f"{path}: extras.ground is no grid of shares ({type(error).__name__}: {error})") from None
    if not (min(sky.shape) >= 2 and dx > 0.0 and dy > 0.0 and np.isfinite([x0, y0, dx, dy]).all()
            and ((sky >= 0.0) & (sky <= 1.0)).all()):
        raise FileError(f"{path}: extras.ground is no grid of shares from 0 to 1 with steps above 0")
    return Contact(sky, np.array([x0, y0]), np.array([dx, 0.0]), np.array([0.0, dy]))
