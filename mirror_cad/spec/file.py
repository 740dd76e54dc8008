"""Specifications as TOML files and as JSON; every fault found is reported at once."""

from __future__ import annotations

import difflib
import math
import tomllib
from collections.abc import Mapping
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from mirror_cad.errors import SpecError
from mirror_cad.laws import Unstated
from mirror_cad.messages import faults
from mirror_cad.spec.schema import MirrorSpec

Root = TypeVar("Root", bound=BaseModel)

LARGEST_FILE = 10_000_000  # bytes: a specification is a page of text, a table of 100,000 rows a few megabytes


def preset_names() -> list[str]:
    """List the names of the mirrors that come with the package."""
    return names_in(_designs())


def names_in(folder: Traversable) -> list[str]:
    """List what the TOML files of one of the package's folders are called."""
    return sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))


def load_spec(name_or_path: str | Path) -> MirrorSpec:
    """Read a specification.

    Parameters
    ----------
    name_or_path : str or Path
        The name of a preset, or a TOML file.

    Raises
    ------
    SpecError
        With one fault for each unknown, missing, ill-typed or impossible key.
    """
    raw, source, folder = read_toml(name_or_path, _designs(), "preset")
    raw.setdefault("name", Path(name_or_path).stem)
    return validate_spec(raw, source, folder)


def read_toml(name_or_path: str | Path, built_in: Traversable, kind: str) -> tuple[dict[str, Any], str, Path]:
    """Read a TOML file, or the one of that name in one of the package's folders.

    Parameters
    ----------
    name_or_path : str or Path
    built_in : Traversable
        The package's folder.
    kind : str
        What its files are called in messages.

    Returns
    -------
    dict, str, Path
        The keys, what to call the file in messages, and the folder that file names in it are relative to.

    Raises
    ------
    SpecError
        For a file that is missing, too large, no text or no TOML.
    """
    path = Path(name_or_path)
    names = names_in(built_in)
    if str(name_or_path) in names:
        text, source, folder = (built_in / f"{name_or_path}.toml").read_text("utf-8"), str(name_or_path), Path(".")
    else:
        text, source, folder = _read_text(path, names, kind), path.name, path.parent
    try:
        return tomllib.loads(text), source, folder
    except tomllib.TOMLDecodeError as error:
        raise SpecError(f"{source}: not TOML: {error}") from None
    except ValueError:  # Python reads no whole number of more than 4,300 digits
        raise SpecError(f"{source}: not TOML: a number with thousands of digits") from None
    except RecursionError:
        raise SpecError(f"{source}: nested too deeply to be a specification") from None


def validate_spec(raw: Mapping[str, object], source: str = "specification", folder: Path = Path(".")) -> MirrorSpec:
    """Check a specification given as nested dictionaries.

    Parameters
    ----------
    raw : Mapping
        Sections with their keys, as TOML holds them.
    source : str
        What messages begin with.
    folder : Path
        What file names in it are relative to.

    Raises
    ------
    SpecError
        With a sentence for every fault.
    """
    return validated(MirrorSpec, raw, source, folder)


def validated(model: type[Root], raw: Mapping[str, object], source: str, folder: Path) -> Root:
    """Check nested dictionaries by a root model, as `validate_spec` does."""
    try:
        return model.model_validate(dict(raw), context={"folder": folder})
    except (ValidationError, OverflowError) as error:
        raise SpecError(faults(error, raw, model, source)) from None


def spec_as_json(spec: MirrorSpec) -> dict[str, Any]:
    """Make JSON of a specification, which can be read again.

    Without what was left out, with an infinite radius as the text "inf", and of an outline from a file without the sizes
    that it replaces.
    """

    def plain(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: plain(item) for key, item in value.items()}
        if isinstance(value, list | tuple):
            return [plain(item) for item in value]
        return str(value) if isinstance(value, float) and not math.isfinite(value) else value

    content: dict[str, Any] = plain(spec.model_dump(mode="python", exclude_none=True, warnings=False))
    for section in ("horizontal", "vertical"):
        if isinstance(getattr(spec, section), Unstated):
            del content[section]
    if spec.outline.file is not None:
        given = spec.outline.model_fields_set
        content["outline"] = {key: value for key, value in content["outline"].items() if key in given}
    return content


def _designs() -> Traversable:
    return resources.files("mirror_cad") / "designs"


def _read_text(path: Path, names: list[str], kind: str) -> str:
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise SpecError(f"{path}: {path.stat().st_size / 1e6:.1f} MB is no specification (at most 10 MB are read)")
        return path.read_text("utf-8-sig")
    except FileNotFoundError:
        near = difflib.get_close_matches(str(path), names, n=1, cutoff=0.5)
        plural = kind[:-1] + "ies" if kind.endswith("y") else f"{kind}s"
        hint = f"; did you mean the {kind} {near[0]!r}?" if near else f"; the {plural} are {', '.join(names)}"
        raise SpecError(f"{path}: no such file or {kind}{hint}") from None
    except UnicodeDecodeError as error:
        raise SpecError(f"{path}: not a text file (byte {error.start} is no UTF-8): a specification is TOML") from None
    except OSError as error:
        raise SpecError(f"{path}: cannot be read: {error.strerror or error}") from None
    except ValueError as error:  # a name that no file can have
        raise SpecError(f"{path}: cannot be read: {error}") from None
