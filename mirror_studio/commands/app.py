"""What the commands share: where they are listed, options that several have, and how they end."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

if TYPE_CHECKING:
    from mirror_studio.json_types import JsonObject

DONE, FAILED, BAD_INPUT, MISSED = 0, 1, 2, 3


def _version() -> str:
    from importlib.metadata import version

    return version("mirror-cad")


app = App(
    name="mirror-cad",
    version=_version,
    help="Design freeform mirrors on a CAD kernel and see, before anything is made, what they show.",
    version_flags=["--version"],
    suppress_keyboard_interrupt=False,
    help_format="plaintext",  # markdown would double the time to start
    result_action="return_value",
)

Out = Annotated[Path | None, Parameter(name="--out", help="Folder for the files; replaced as a whole.")]
Json = Annotated[bool, Parameter(name="--json", negative=(), help="Print the metrics as JSON to the standard output.")]
Pdf = Annotated[bool, Parameter(name="--pdf", negative=(), help="Write the report as PDF too; needs the extra `pdf`.")]
# Nine numbers may begin with a minus.
PlaceText = Annotated[str, Parameter(name="--place", allow_leading_hyphen=True)]


def start_cad_reader(files: list[Path], designed: bool = False) -> None:
    """Start the process with the CAD kernel beside our own imports, where a CAD file is among the files.

    designed : or a preset or a specification, whose mirror is written and read there.
    """
    from raytrace.file_kinds import CAD_KINDS

    kinds = (*CAD_KINDS, "", ".toml") if designed else CAD_KINDS
    if any(file.suffix.lower() in kinds for file in files):
        from mirror_cad.kernel import start_reader

        start_reader()


def finish(metrics: JsonObject, missed: tuple[str, ...], as_json: bool) -> int:
    """Print the metrics where they were asked for, and what was missed; the exit code."""
    if as_json:
        print(json.dumps(metrics, indent=2, ensure_ascii=False))
    for text in missed:
        print(f"mirror-cad: missed: {text}", file=sys.stderr)
    return MISSED if missed else DONE
