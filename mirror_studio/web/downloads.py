"""A specification in, its files out: made by the real pipeline in a process of its own, with progress and cancel."""

from __future__ import annotations

import asyncio
import contextlib
import re
import secrets
import shutil
import signal
import sys
import tempfile
import zipfile
from collections import OrderedDict
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path

from mirror_cad.errors import WriteError
from mirror_cad.spec import MirrorSpec
from mirror_studio.web.protocol import Look
from mirror_studio.web.state import FILES, as_toml
from mirror_studio.web.uploads import Uploads

KEPT = 4  # sets of files; the oldest go
LONGEST_SECONDS = 600
POLITE_SECONDS = 5
STEP = re.compile(r"\[ *[0-9.]+ s\] (.*)")
Report = Callable[[str], Awaitable[None]]

# What can be taken away: the file's name in a set, "{name}" being the mirror's, and its media type.
KINDS = {
    "step": ("{name}.step", "model/step"),
    "surface": ("{name}-surface.step", "model/step"),
    "stl": ("{name}.stl", "model/stl"),
    "spec": ("{name}.toml", "application/toml"),
    "picture": ("driver-view.png", "image/png"),
    "report": ("report.html", "text/html"),
    "metrics": ("metrics.json", "application/json"),
    "deviation": ("deviation.json", "application/json"),
    "all": ("{name}.zip", "application/zip"),
}


class NotMadeError(Exception):
    """The files could not be made: the pipeline's own words."""


@dataclass(frozen=True, slots=True)
class FileSet:
    """A built set under a secret token, and what the pipeline says was missed."""

    token: str
    name: str
    folder: Path
    missed: tuple[str, ...]

    def file(self, kind: str) -> tuple[Path, str, str]:
        """Path, name to save it under, and media type. Raises: KeyError for another kind."""
        pattern, media = KINDS[kind]
        path = self.folder / pattern.format(name=self.name)
        shown = path.name if self.name in path.name else f"{self.name}-{path.name}"
        return path, shown, media


class Downloads:
    """The sets of files that have been made, by their tokens; the same specification is made once."""

    def __init__(self) -> None:
        self._folder = Path(tempfile.mkdtemp(prefix="mirror-cad-studio-files-"))
        self._sets: OrderedDict[str, FileSet] = OrderedDict()
        self._one_at_a_time = asyncio.Lock()

    def close(self) -> None:
        """Remove everything."""
        shutil.rmtree(self._folder, ignore_errors=True)

    def get(self, token: str) -> FileSet | None:
        """The set with this token."""
        return next((one for one in self._sets.values() if secrets.compare_digest(one.token.encode(), token.encode())), None)

    async def build(self, spec: MirrorSpec, look: Look, uploads: Uploads, report: Report) -> FileSet:
        """Build a specification with `mirror-cad build`, as a child; cancelling this ends the child.

        Raises: NotMadeError with what the pipeline said; WriteError where it took too long.
        """
        text = as_toml(spec, look)
        if text in self._sets:
            self._sets.move_to_end(text)
            return self._sets[text]
        await report("waiting for another build" if self._one_at_a_time.locked() else "starting")
        async with self._one_at_a_time:
            made = await self._make(spec, text, uploads, report)
        self._sets[text] = made
        while len(self._sets) > KEPT:
            shutil.rmtree(self._sets.popitem(last=False)[1].folder.parent, ignore_errors=True)
        return made

    async def _make(self, spec: MirrorSpec, text: str, uploads: Uploads, report: Report) -> FileSet:
        home = Path(tempfile.mkdtemp(dir=self._folder))
        try:
            source, out = home / f"{spec.name}.toml", home / "files"
            source.write_text(text, encoding="utf-8")
            brought = [Path(value) for section, key in FILES if uploads.has(Path(value := str(getattr(
                getattr(spec, section), key))).name)]
            for path in brought:
                shutil.copy(uploads.folder / path.name, home / path.name)
            missed = await self._run(source, out, report)
            await asyncio.to_thread(_pack, out, source, [home / path.name for path in brought], spec.name)
        except BaseException:
            shutil.rmtree(home, ignore_errors=True)
            raise
        return FileSet(secrets.token_urlsafe(24), spec.name, out, missed)

    @staticmethod
    async def _run(source: Path, out: Path, report: Report) -> tuple[str, ...]:
        child = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "mirror_studio", "build", str(source), "--out", str(out),
            stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.DEVNULL, stderr=asyncio.subprocess.PIPE)
        said: list[str] = []
        try:
            async with asyncio.timeout(LONGEST_SECONDS):
                assert child.stderr is not None  # asked for above
                async for line in child.stderr:
                    text = line.decode("utf-8", "replace").strip()
                    step = STEP.fullmatch(text)
                    if step is None:
                        said.append(text.removeprefix("mirror-cad: "))
                    else:
                        await report(step[1].removeprefix(f"{source.stem}: ").replace(f", in {out}", ""))
                code = await child.wait()
        except TimeoutError:
            raise WriteError(f"the files took more than {LONGEST_SECONDS} s to make") from None
        finally:
            if child.returncode is None:
                with contextlib.suppress(ProcessLookupError):
                    child.send_signal(signal.SIGTERM)
                try:
                    await asyncio.wait_for(child.wait(), POLITE_SECONDS)
                except TimeoutError:
                    child.kill()
        if code not in (0, 3):
            raise NotMadeError("\n".join(text.replace(str(source.parent), "") for text in said) or f"ended with {code}")
        return tuple(text.removeprefix("missed: ") for text in said if text.startswith("missed: "))


def _pack(out: Path, source: Path, brought: list[Path], name: str) -> None:
    """Put the specification and what it names beside the files, and all of them into one archive."""
    for path in (source, *brought):
        shutil.copy(path, out / path.name)
    with zipfile.ZipFile(out.parent / f"{name}.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(out.rglob("*")):
            if path.is_file():
                archive.write(path, Path(name) / path.relative_to(out))
    shutil.move(out.parent / f"{name}.zip", out / f"{name}.zip")
