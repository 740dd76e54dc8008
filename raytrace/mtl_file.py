"""The material files and pictures that an OBJ file names in, materials and what is left of them out.

Source: Wavefront, MTL material format, 1995; Pr (roughness) and the like are later additions.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import FileError
from raytrace.obj_file import logical_lines, text_of
from raytrace.pictures import Decoded
from raytrace.scene.materials import Material

Array = NDArray[np.float64]
LoadPicture = Callable[[bytes, str], Decoded]

# What stands behind an option of a map, and how many words that is at most; numbers end where no number follows.
OPTIONS = {"-blendu": 1, "-blendv": 1, "-cc": 1, "-clamp": 1, "-texres": 1, "-bm": 1, "-boost": 1, "-imfchan": 1, "-type": 1,
           "-mm": 2, "-o": 3, "-s": 3, "-t": 3}
# Maps that change what is seen and are not drawn.
UNDRAWN = {"map_ks": "specular maps", "map_bump": "bump maps", "bump": "bump maps", "norm": "normal maps",
           "disp": "displacement", "map_ke": "emission", "map_pr": "roughness maps", "map_pm": "metalness maps"}
CUT_BELOW = 0.5  # share of cover below which a map of it lets rays pass: the default of the formats that have one


class Placed(NamedTuple):
    """A picture's name, and what its options do to texture coordinates: scale·(u, v) + offset."""

    name: str
    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)


@dataclass
class _Entry:
    """One material as its file has it."""

    diffuse: tuple[float, float, float] | None = None
    shininess: float = 0.0
    roughness: float | None = None
    opacity: float = 1.0
    picture: Placed | None = None
    cover: Placed | None = None
    undrawn: set[str] = field(default_factory=set)


class ObjMaterial(NamedTuple):
    """A material, and where its picture lies: scale·(u, v) + offset, v upwards."""

    material: Material
    placed: Placed


def materials_of(path: Path, libraries: tuple[str, ...], load_picture: LoadPicture) -> tuple[dict[str, ObjMaterial], set[str]]:
    """The materials of an OBJ file's libraries by name, and what of them is left out.

    Kd is taken as linear, the shininess Ns as a roughness, d (or 1 − Tr) as the share that a surface covers, map_d as a
    cutout.

    Raises
    ------
    FileError
        For libraries and pictures that are missing or broken, and for numbers that are none.
    """
    entries: dict[str, _Entry] = {}
    for name in libraries:
        _read(path, beside(path, name, "material file"), name, entries)
    known: dict[str, Decoded] = {}

    def picture(name: str) -> Decoded:
        if name not in known:
            known[name] = load_picture(beside(path, name, "picture"), f"{path}: picture {name!r}")
        return known[name]

    left_out: set[str] = set()
    made = {}
    for name, entry in entries.items():
        left_out |= entry.undrawn
        made[name] = _material(name, entry, picture, left_out)
    return made, left_out


def _material(name: str, entry: _Entry, picture: Callable[[str], Decoded], left_out: set[str]) -> ObjMaterial:
    texture = picture(entry.picture.name) if entry.picture else None
    cover = None
    if entry.cover is not None:
        given = picture(entry.cover.name)
        cover = given.alpha if given.alpha is not None else np.ascontiguousarray(given.colours[..., 0])
        if entry.picture is not None and entry.cover[1:] != entry.picture[1:]:
            left_out.add("a cutout that lies otherwise than its picture")
            cover = None
    elif texture is not None and texture.alpha is not None:
        left_out.add("transparency of pictures without map_d")
    if entry.diffuse is None and texture is None:
        diffuse = (0.5, 0.5, 0.5)
    else:
        red, green, blue = (min(max(v, 0.0), 1.0) for v in entry.diffuse or (1.0, 1.0, 1.0))
        diffuse = (red, green, blue)
    # Blinn's exponent is 2/α² − 2, and α the roughness squared.
    roughness = entry.roughness if entry.roughness is not None else (2.0 / (max(entry.shininess, 0.0) + 2.0)) ** 0.25
    material = Material(name, diffuse, roughness=min(max(roughness, 0.0), 1.0),
                        texture=None if texture is None else texture.colours, opacity=min(max(entry.opacity, 0.0), 1.0),
                        cover=cover, cutoff=CUT_BELOW if cover is not None else None)
    return ObjMaterial(material, entry.picture or entry.cover or Placed(""))


def _read(path: Path, data: bytes, library: str, entries: dict[str, _Entry]) -> None:
    entry = None
    for number, line in enumerate(logical_lines(data), 1):
        kind, _, rest = line.partition(b" ")
        key, words = kind.decode("ascii", "replace").lower(), text_of(rest).split()
        if key == "newmtl":
            entry = entries.setdefault(text_of(rest), _Entry())
            continue
        if entry is None or not words:
            continue
        try:
            match key:
                case "kd":
                    entry.diffuse = _colour(words, entry)
                case "ns":
                    entry.shininess = _number(words[0])
                case "pr":
                    entry.roughness = _number(words[0])
                case "d":
                    entry.opacity = _number(words[1] if words[0] == "-halo" else words[0])
                case "tr":
                    entry.opacity = 1.0 - _number(words[0])
                case "map_kd":
                    entry.picture = _placed(text_of(rest))
                case "map_d" | "map_opacity":
                    entry.cover = _placed(text_of(rest))
                case _ if key in UNDRAWN:
                    entry.undrawn.add(UNDRAWN[key])
        except (ValueError, IndexError):
            raise FileError(f"{path}: its material file {library!r}, line {number}: {text_of(line)!r} is not "
                            "understood") from None


def _number(word: str) -> float:
    value = float(word)
    if not np.isfinite(value):
        raise ValueError
    return value


def _colour(words: list[str], entry: _Entry) -> tuple[float, float, float] | None:
    if words[0].lower() in ("spectral", "xyz"):
        entry.undrawn.add("colours as spectra or XYZ")
        return entry.diffuse
    values = [_number(word) for word in words[:3]]
    red, green, blue = values if len(values) == 3 else 3 * values[:1]
    return red, green, blue


def _placed(text: str) -> Placed:
    """A map's options and its file's name, which may hold blanks."""
    numbers = {"-s": [1.0, 1.0], "-o": [0.0, 0.0]}
    while text.startswith("-"):
        option, _, rest = text.partition(" ")
        if option.lower() not in OPTIONS:
            break
        text = rest.strip()
        for k in range(OPTIONS[option.lower()]):
            word, _, rest = text.partition(" ")
            if not rest.strip() or (k > 0 and re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?", word, re.IGNORECASE) is None):
                break  # the last word is the file's name
            text = rest.strip()
            if k < 2 and option.lower() in numbers:
                numbers[option.lower()][k] = _number(word)
    if text[:1] in "\"'" and text[:1]:
        text = (shlex.split(text.replace("\\", "/")) or [text])[0]
    (su, sv), (ou, ov) = numbers["-s"], numbers["-o"]
    return Placed(text, (su, sv), (ou, ov))


def beside(path: Path, name: str, what: str) -> bytes:
    """A file that another names, from where that one lies.

    With back slashes as Windows writes them, in another case, or, where it is named by a place on another machine, by its
    last name.

    Raises
    ------
    FileError
        For one that cannot be read.
    """
    plain = name.replace("\\", "/")
    try:
        for tried in (name, plain, PurePosixPath(plain).name):
            file = _in_any_case(path.parent, tried)
            if file is not None:
                return file.read_bytes()
        return (path.parent / plain).read_bytes()
    except (OSError, ValueError) as error:  # a name with a zero byte is a ValueError
        reason = error.strerror if isinstance(error, OSError) else None
        raise FileError(f"{path}: its {what} {PurePosixPath(plain).name!r} cannot be read: {reason or error}") from None


def _in_any_case(folder: Path, name: str) -> Path | None:
    """The file of a name, the case of letters left out of account where there is none that is written so."""
    if "\0" in name or not name:
        return None
    file = folder / name
    if file.is_file():
        return file
    at = Path("/") if name.startswith("/") else folder
    for word in PurePosixPath(name.lstrip("/")).parts:
        following = at / word
        if not following.exists():
            alike = [entry for entry in at.iterdir() if entry.name.lower() == word.lower()] if at.is_dir() else []
            if not alike:
                return None
            following = alike[0]
        at = following
    return at if at.is_file() else None
