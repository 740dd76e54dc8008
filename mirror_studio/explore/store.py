"""The rows of a study on the disk: appended one by one, read again, and written as tables."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import astuple
from io import FileIO
from pathlib import Path

from mirror_cad.errors import SpecError, WriteError
from mirror_studio.explore.evaluate import Row
from mirror_studio.explore.replaced import replace_table, replace_with
from mirror_studio.explore.study import Variants

STORE = "study.jsonl"


class Store:
    """An append-only file of rows: what a kill leaves of its last line is cut off, and no row is taken twice.

    Raises: SpecError where the folder holds another study; WriteError where it cannot be written.
    """

    def __init__(self, folder: Path, study: Variants) -> None:
        self.path, self.study = folder / STORE, study
        head: dict[str, object] = {"study": study.digest(), "keys": list(study.keys), "measures": list(study.measures)}
        self.rows: dict[int, Row] = {}
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._read(head)
            # Without a buffer: what a full disk did not take would be tried again as the file is closed.
            self._stream: FileIO = self.path.open("r+b" if self.path.exists() else "w+b", buffering=0)
            if not _locked(self._stream):
                self._stream.close()
                raise SpecError(f"{folder}: another command is at work on this study: wait for it, or give another --out")
            kept = self._read(head)  # once more: what is whole now that nobody else writes
            self._stream.truncate(kept)
            self._stream.seek(kept)
            if not kept:
                self._write(head)
        except OSError as error:
            raise WriteError(f"{self.path}: cannot be written: {error.strerror or error}") from None

    def _read(self, head: Mapping[str, object]) -> int:
        """Take the whole lines; returns how many bytes they are."""
        if not self.path.exists():
            return 0
        content, kept = self.path.read_bytes(), 0
        for line in content.splitlines(keepends=True):
            if not line.endswith(b"\n"):
                break
            try:
                entry = json.loads(line)
            except ValueError:
                break
            if kept == 0:
                if entry != head:
                    raise SpecError(f"{self.path.parent}: holds the rows of another study: give another --out, or remove it")
            else:
                row = Row(entry[0], tuple(entry[1]), tuple(entry[2]), entry[3], entry[4])
                self.rows.setdefault(row.index, row)
            kept += len(line)
        return kept

    def append(self, row: Row) -> None:
        """Keep a row, on the disk before this returns."""
        if row.index in self.rows:
            return
        self._write(astuple(row))
        self.rows[row.index] = row

    def _write(self, entry: object) -> None:
        try:
            left = memoryview(json.dumps(entry, ensure_ascii=False).encode() + b"\n")
            while left:
                left = left[self._stream.write(left):]
            os.fsync(self._stream.fileno())
        except OSError as error:
            raise WriteError(f"{self.path}: cannot be written: {error.strerror or error}; what is there is whole, and the same "
                             "command goes on from it") from None

    def close(self) -> None:
        """Close the file; what was appended is on disk."""
        self._stream.close()

    def tables(self) -> None:
        """Write rows.csv and rows.parquet beside it, in the order of the designs."""
        write_rows(self.path.parent, "rows", self.study, [self.rows[index] for index in sorted(self.rows)], parquet=True)


def _locked(stream: FileIO) -> bool:
    """Keep other commands from a file until it is closed; whether none has it. The system ends that with the process."""
    try:
        import fcntl
    except ModuleNotFoundError:  # not on this system
        return True
    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def write_rows(folder: Path, name: str, study: Variants, rows: Sequence[Row], parquet: bool = False,
               more: Mapping[str, Sequence[object]] | None = None) -> None:
    """Write NAME.csv, and NAME.parquet where asked for: a column a key and a measure, status, cause, and more of them."""
    columns: dict[str, list[object]] = {}
    for k, key in enumerate(study.keys):
        columns[key] = [row.values[k] for row in rows]
    for k, measure in enumerate(study.measures):
        columns[measure] = [row.figures[k] for row in rows]
    columns |= {"status": [row.status for row in rows], "cause": [row.cause for row in rows]}
    columns |= {name: list(values) for name, values in (more or {}).items()}
    whole = f"; the rows are whole in {STORE}"
    replace_table(folder / f"{name}.csv", list(columns), zip(*columns.values(), strict=True), whole)
    if parquet:
        import pyarrow  # type: ignore[import-untyped]
        import pyarrow.parquet  # type: ignore[import-untyped]

        measured = {name: pyarrow.float64() for name in study.measures}
        arrays = [pyarrow.array(values, type=measured.get(key)) for key, values in columns.items()]
        table = pyarrow.table(arrays, names=list(columns))
        replace_with(folder / f"{name}.parquet", lambda beside: pyarrow.parquet.write_table(table, beside), whole)
