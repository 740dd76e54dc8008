"""Store files from the page, checked, under names of our choosing: the page's names never reach the file system."""

from __future__ import annotations

import hashlib
import pickle
import re
import shutil
import tempfile
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from mirror_cad.errors import FileError, MirrorError, SpecError
from mirror_cad.guarded import FallenError, GuardedProcess

if TYPE_CHECKING:
    from raytrace.reflector import Reflector

Kind = Literal["outline", "picture", "reflector", "measured", "table", "spec"]

Read = TypeVar("Read")


@dataclass(frozen=True, slots=True)
class Limit:
    """Which endings a kind of file may have, and how large it may be, bytes."""

    endings: tuple[str, ...]
    largest: int


LIMITS: dict[Kind, Limit] = {
    "outline": Limit((".dxf", ".svg"), 5_000_000),
    "picture": Limit((".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tif", ".tiff"), 40_000_000),
    "reflector": Limit((".step", ".stp", ".iges", ".igs", ".brep", ".brp", ".stl", ".obj", ".ply", ".off"), 60_000_000),
    # What `mirror-cad inspect` reads; by itself, when the data are laid on a design.
    "measured": Limit((".csv", ".tsv", ".txt", ".xyz", ".asc", ".pts", ".dat", ".stl", ".ply", ".obj", ".off", ".glb", ".3mf",
                       ".step", ".stp", ".iges", ".igs", ".brep", ".brp"), 200_000_000),
    "table": Limit((".csv", ".txt"), 4_000_000),
    "spec": Limit((".toml",), 1_000_000),
}
NAME = re.compile(r"[0-9a-f]{24}\.[a-z0-9]{3,4}")
LONGEST_NAME = 64  # characters of a file's name, without its ending
MAX_FILES = 40  # kept; the oldest go
READING_SECONDS = 60.0  # of the clock
MAX_MEMORY = 6_000_000_000  # bytes of address space: the kernel alone maps two


class Uploads:
    """A folder of its own, with the files that pages have brought in, each named by the hash of its content."""

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="mirror-cad-studio-"))
        self._names: list[str] = []
        self._shown: dict[str, str] = {}
        self._lock = threading.Lock()

    def close(self) -> None:
        """Remove everything."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def has(self, name: Any) -> bool:
        """Whether this is the name of a file here; of anything else it is not, whatever it is."""
        return isinstance(name, str) and NAME.fullmatch(name) is not None and name in self._names

    def shown(self, name: str) -> str:
        """What the owner of a file called it, cleaned; the name itself where that is not known."""
        return self._shown.get(name, name)

    def in_words(self, text: str) -> str:
        """A message without this folder, and with the files' names as their owners gave them."""
        return NAME.sub(lambda found: self.shown(found[0]), text.replace(f"{self.folder}/", ""))

    def add(self, kind: Kind, ending: str, data: bytes, shown: str = "") -> str:
        """Store a file that has been looked at by a child process; returns its name.

        shown : what its owner calls it.

        Raises: FileError, SpecError or another MirrorError for one of another kind, too large, or that cannot be read.
        """
        check(kind, ending, len(data))
        name = hashlib.sha256(data).hexdigest()[:24] + ending
        path = self.folder / name
        with self._lock:
            if shown:
                self._shown[name] = cleaned(shown, ending, name)
            if name in self._names:
                return name
            path.write_bytes(data)
        try:
            if kind != "measured":
                self._look_at(kind, path, self.shown(name) if shown else "the file")
        except BaseException:
            path.unlink(missing_ok=True)
            self._shown.pop(name, None)
            raise
        with self._lock:
            self._names.append(name)
            for old in self._names[:-MAX_FILES]:
                self._shown.pop(old, None)
                for left in self.folder.glob(f"{old}*"):
                    left.unlink(missing_ok=True)
            del self._names[:-MAX_FILES]
        return name

    def reflector(self, name: str) -> Reflector:
        """An uploaded reflector. Raises: SpecError where there is none of that name."""
        if not self.has(name):
            raise SpecError("your own mirror is no longer here: bring it in again")
        return _unpickled(self.folder / f"{name}.read")

    def _look_at(self, kind: Kind, path: Path, shown: str) -> None:
        """Read the file once in a child with limits on its time and memory: a hostile file ends the child alone."""
        with GuardedProcess(MAX_MEMORY) as child:
            try:
                child.call("mirror_studio.web.reading:read", kind, str(path), seconds=READING_SECONDS,
                           longest_seconds=READING_SECONDS)
            except (FallenError, RuntimeError) as error:
                how = f" ({error})" if isinstance(error, FallenError) else ""  # a RuntimeError is a long traceback
                raise FileError(f"{shown} cannot be read: its reader ran out of time or memory, or broke down on it{how}"
                                ) from None
            except MirrorError as error:
                raise SpecError([text.replace(f"{path.parent}/", "").replace(path.name, shown)
                                 for text in str(error).splitlines()]) from None
            except MemoryError:
                raise FileError(f"{shown} needs too much memory") from None


@lru_cache(maxsize=4)
def _unpickled(path: Path) -> Reflector:
    # Written by our own child into our own folder.
    reflector: Reflector = pickle.loads(path.read_bytes())
    return reflector


def cleaned(shown: str, ending: str, instead: str) -> str:
    """A file's name without folders and with letters, digits, '.', '_' and '-' alone; `instead` where nothing is left."""
    stem = re.sub(r"[^A-Za-z0-9._-]+", "_", re.split(r"[/\\]", shown)[-1])
    stem = stem[:-len(ending)] if stem.lower().endswith(ending) else stem
    stem = stem[:LONGEST_NAME].strip("._-")
    return stem + ending if stem else instead


def check(kind: Kind, ending: str, size: int) -> None:
    """Raise FileError for an ending or a size that this kind of file may not have."""
    limit = LIMITS[kind]
    if ending not in limit.endings:
        given = ending[:12] or "a file without ending"
        raise FileError(f"a {kind} is read from {', '.join(limit.endings)}, not from {given!r}")
    if size > limit.largest:
        raise FileError(f"the file has {size / 1e6:.1f} MB; a {kind} may have {limit.largest / 1e6:g} MB")


def in_folder(uploads: Uploads, ending: str, data: bytes, read: Callable[[Path], Read]) -> Read:
    """What `read` makes of a file with this content, which is removed again."""
    with tempfile.NamedTemporaryFile(dir=uploads.folder, suffix=ending) as stream:
        stream.write(data)
        stream.flush()
        return read(Path(stream.name))
