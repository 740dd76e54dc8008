"""Print a report as PDF, where this machine can."""

from __future__ import annotations

import logging
import sys
from pathlib import Path

from mirror_cad.errors import MirrorError, SpecError, WriteError

PANGO = "libpango-1.0-0, libpangoft2-1.0-0 and libharfbuzz-subset0"


def check_pdf() -> None:
    """Raise SpecError, saying what to install, where no PDF can be made here."""
    try:
        import weasyprint  # type: ignore[import-untyped]  # noqa: F401
    except ImportError:
        raise SpecError("--pdf: the package weasyprint is not installed: `pip install 'mirror-cad[pdf]'` brings it") from None
    except OSError as error:
        library = str(error).split("'")[1] if "'" in str(error) else str(error).splitlines()[0]
        raise SpecError(f"--pdf: the system library {library} cannot be loaded, which weasyprint sets type with: install the "
                        f"packages {PANGO} (their names on Debian and Ubuntu)") from None


def write_pdf(page: Path, path: Path) -> None:
    """Write the pages of a self-contained HTML file; only what is embedded in it is read. Raises: WriteError."""
    from weasyprint import HTML  # type: ignore[import-untyped]
    from weasyprint.urls import URLFetcher  # type: ignore[import-untyped]

    logging.getLogger("weasyprint").setLevel(logging.ERROR)  # warnings are of rules for screens
    HTML(string=page.read_text("utf-8"), url_fetcher=URLFetcher(allowed_protocols=("data",))).write_pdf(path)
    if not path.read_bytes().startswith(b"%PDF-"):
        raise WriteError(f"{path.name}: the PDF could not be written")


def main() -> None:
    """The two files of `write_pdf` as arguments; where it cannot be done, one line that says why and exit code 1."""
    try:
        check_pdf()
        write_pdf(Path(sys.argv[1]), Path(sys.argv[2]))
    except MirrorError as error:
        sys.exit(str(error).removeprefix("--pdf: "))
