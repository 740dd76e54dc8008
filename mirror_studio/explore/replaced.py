"""Files of a study that takes long, each replaced whole: written beside the old one and renamed, so that a kill leaves one."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from mirror_cad.errors import WriteError


def replace_with(path: Path, write: Callable[[Path], object], more: str = "") -> None:
    """Write a file beside the one that it replaces, and rename it.

    Parameters
    ----------
    path : Path
        What is replaced, or is new.
    write : callable
        Takes the path of the file beside, and writes it.
    more : str
        What the message of an error says after its cause.

    Raises
    ------
    WriteError
        Where the disk takes no more, or the file may not be written.
    """
    beside = path.with_name(f".{path.name}")
    try:
        write(beside)
        beside.replace(path)
    except OSError as error:
        raise WriteError(f"{path}: cannot be written: {error.strerror or error}{more}") from None


def replace_text(path: Path, text: str, more: str = "") -> None:
    """Replace a file by a text in UTF-8, as `replace_with` does.

    Parameters
    ----------
    path : Path
    text : str
    more : str
        What the message of an error says after its cause.
    """
    replace_with(path, lambda beside: beside.write_bytes(text.encode()), more)


def replace_table(path: Path, names: Sequence[str], rows: Iterable[Sequence[object]], more: str = "") -> None:
    """Replace a file by a CSV table, as `replace_with` does: floats with all their digits, None as nothing.

    Parameters
    ----------
    path : Path
    names : sequence of str
        Of the columns.
    rows : iterable of sequences
    more : str
        What the message of an error says after its cause.
    """
    stream = io.StringIO(newline="")
    writer = csv.writer(stream)
    writer.writerow(names)
    writer.writerows([("" if value is None else repr(value) if isinstance(value, float) else value) for value in row]
                     for row in rows)
    replace_text(path, stream.getvalue(), more)
