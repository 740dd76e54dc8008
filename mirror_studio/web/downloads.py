"""Make the files of a design by the real pipeline in a process by itself, with progress and cancel."""

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
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from mirror_cad.errors import WriteError
from mirror_cad.spec import MirrorSpec
from mirror_studio.web.protocol import Inspect, ViewSettings
from mirror_studio.web.state import as_toml, files_of
from mirror_studio.web.uploads import Uploads

KEPT = 4  # sets of files; the oldest go
LONGEST_SECONDS = 600
POLITE_SECONDS = 5
PDF_SECONDS = 120
INPUTS = "inputs"  # the folder of a set with the files that its specification names
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
    "pdf": ("report.pdf", "application/pdf"),
    "metrics": ("metrics.json", "application/json"),
    "deviation": ("deviation.json", "application/json"),
    "all": ("{name}.zip", "application/zip"),
    "measured": ("{name}-measured.step", "model/step"),
    "inspection": ("inspection.json", "application/json"),
    "maps": ("{name}-maps.csv", "text/csv"),
}


def kinds() -> list[str]:
    """What can be taken away here: no PDF without the package that makes it."""
    return [kind for kind in KINDS if kind != "pdf" or find_spec("weasyprint") is not None]


class NotMadeError(Exception):
    """The files could not be made: the pipeline's own words."""


@dataclass(frozen=True, slots=True)
class FileSet:
    """A built set under a secret token, what the pipeline says was missed, and what the set is not of what the page shows.

    Of a measured mirror it is what `mirror-cad inspect` writes.
    """

    token: str
    name: str
    folder: Path
    missed: tuple[str, ...]
    notes: tuple[str, ...]

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
        self._one_at_a_time, self._one_pdf_at_a_time = asyncio.Lock(), asyncio.Lock()

    def close(self) -> None:
        """Remove everything."""
        shutil.rmtree(self._folder, ignore_errors=True)

    def get(self, token: str) -> FileSet | None:
        """The set with this token."""
        return next((one for one in self._sets.values() if secrets.compare_digest(one.token.encode(), token.encode())), None)

    async def build(self, spec: MirrorSpec, look: ViewSettings, uploads: Uploads, report: Report) -> FileSet:
        """Build a specification with `mirror-cad build`, as a child; cancelling this ends the child.

        Raises: NotMadeError with what the pipeline said; WriteError where it took too long.
        """
        await report("waiting for another build" if self._one_at_a_time.locked() else "starting")
        async with self._one_at_a_time:
            return await self._kept(as_toml(spec, look), lambda: self._make(spec, look, uploads, report))

    async def _kept(self, key: str, make: Callable[[], Awaitable[FileSet]]) -> FileSet:
        """The set of this key, made where there is none."""
        if key in self._sets:
            self._sets.move_to_end(key)
            return self._sets[key]
        self._sets[key] = made = await make()
        while len(self._sets) > KEPT:
            shutil.rmtree(self._sets.popitem(last=False)[1].folder.parent, ignore_errors=True)
        return made

    async def inspect(self, spec: MirrorSpec, asked: Inspect, uploads: Uploads, report: Report) -> FileSet:
        """Lay measured data on a specification's design with `mirror-cad inspect`, as a child; cancelling this ends the child.

        Raises: NotMadeError with what the command said; WriteError where it took too long.
        """
        options = ["--align", asked.align, *([] if asked.sigma_mm is None else ["--sigma-mm", repr(asked.sigma_mm)])]
        key = "\n".join([as_toml(spec), *asked.data, *options])
        await report("waiting for another build" if self._one_at_a_time.locked() else "starting")
        async with self._one_at_a_time:
            return await self._kept(key, lambda: self._inspected(spec, asked.data, options, uploads, report))

    async def pdf(self, made: FileSet) -> None:
        """Set a built set's report as PDF, once, in a child. Raises: NotMadeError."""
        path = made.file("pdf")[0]
        async with self._one_pdf_at_a_time:
            if path.exists():
                return
            child = await asyncio.create_subprocess_exec(
                sys.executable, "-c", "from mirror_studio.report.pdf import main; main()", str(made.file("report")[0]),
                str(path), stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.DEVNULL,
                stderr=asyncio.subprocess.PIPE)
            try:
                _, said = await asyncio.wait_for(child.communicate(), PDF_SECONDS)
            except TimeoutError:
                raise NotMadeError(f"the PDF took more than {PDF_SECONDS} s to make") from None
            finally:
                if child.returncode is None:
                    child.kill()
            if child.returncode != 0:
                raise NotMadeError(said.decode("utf-8", "replace").strip() or "no PDF can be made here")

    async def _make(self, spec: MirrorSpec, look: ViewSettings, uploads: Uploads, report: Report) -> FileSet:
        with self._home() as home:
            source, out = home / f"{spec.name}.toml", home / "files"
            files = _written(source, spec, look, uploads)
            missed = await self._run(["build", str(source)], spec.name, home, report)
            await asyncio.to_thread(_pack, out, source, files, spec.name)
        return FileSet(secrets.token_urlsafe(24), spec.name, out, missed, unlike_the_page(spec, look))

    async def _inspected(self, spec: MirrorSpec, data: list[str], options: list[str], uploads: Uploads,
                         report: Report) -> FileSet:
        with self._home() as home:
            source = home / f"{spec.name}.toml"
            _written(source, spec, None, uploads)
            paths = []
            for number, name in enumerate(dict.fromkeys(data), 1):
                path = home / uploads.shown(name)
                # Two files of one name, or one that is called as the specification is.
                paths.append(path.with_name(f"{number}-{path.name}") if path.exists() else path)
                await asyncio.to_thread(shutil.copy, uploads.folder / name, paths[-1])
            missed = await self._run(["inspect", *map(str, paths), "--against", str(source), *options], spec.name, home, report)
        return FileSet(secrets.token_urlsafe(24), spec.name, home / "files", missed, ())

    @contextlib.contextmanager
    def _home(self) -> Iterator[Path]:
        """A folder for a set and what it is made of; gone where that fails."""
        home = Path(tempfile.mkdtemp(dir=self._folder))
        try:
            yield home
        except BaseException:
            shutil.rmtree(home, ignore_errors=True)
            raise

    @staticmethod
    async def _run(arguments: list[str], name: str, home: Path, report: Report) -> tuple[str, ...]:
        """Run a command that writes `home`/files; returns what it says is missed."""
        out = home / "files"
        child = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "mirror_studio", *arguments, "--out", str(out),
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
                        await report(step[1].replace(f", in {out}", "").replace(f"{home}/", "").removeprefix(f"{name}: "))
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
            raise NotMadeError("\n".join(text.replace(f"{home}/", "") for text in said) or f"ended with {code}")
        return tuple(text.removeprefix("missed: ") for text in said if text.startswith("missed: "))


def _written(source: Path, spec: MirrorSpec, look: ViewSettings | None, uploads: Uploads) -> list[Path]:
    """Write a specification, and beside it the uploaded files that it names; returns where these are."""
    names = {name: f"{INPUTS}/{uploads.shown(name)}" for name in files_of(spec, uploads)}
    source.write_text(as_toml(spec, look, names), encoding="utf-8")
    (source.parent / INPUTS).mkdir()
    for name, path in names.items():
        shutil.copy(uploads.folder / name, source.parent / path)
    return [source.parent / path for path in names.values()]


def unlike_the_page(spec: MirrorSpec, look: ViewSettings) -> tuple[str, ...]:
    """In what the files are not of the mirror that the page shows, in words: they are made of the specification alone."""
    notes = []
    turned = [f"{name} of {angle:g}°".replace("-", "−") for name, angle in (("yaw", look.yaw_deg), ("pitch", look.pitch_deg))
              if angle != 0.0]
    if turned and look.view == "picture":
        notes.append(f"report, figures and driver-view.png are of the mirror without its {' and '.join(turned)}")
    if look.view == "road" and look.hand != spec.part.hand:
        notes.append(f"the files are the {spec.part.hand}-hand mirror, as the specification says under Hand; the road shows "
                     f"the {look.hand}-hand one")
    return tuple(notes)


def _pack(out: Path, source: Path, files: list[Path], name: str) -> None:
    """Put the specification and what it names beside the files, and all of them into one archive."""
    shutil.copy(source, out / source.name)
    for path in files:
        (out / INPUTS).mkdir(exist_ok=True)
        shutil.copy(path, out / INPUTS / path.name)
    with zipfile.ZipFile(out.parent / f"{name}.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(out.rglob("*")):
            if path.is_file():
                archive.write(path, Path(name) / path.relative_to(out))
    shutil.move(out.parent / f"{name}.zip", out / f"{name}.zip")
