"""The studio's page."""

from __future__ import annotations

import sys
from pathlib import Path

from mirror_studio.commands.app import BAD_INPUT, DONE, app


@app.command
def studio(*, port: int = 8642, browser: bool = True, study: Path | None = None) -> int:
    """Design by hand: a page on this machine on which a radius is dragged and the road bends.

    Parameters
    ----------
    port
        Where it listens on 127.0.0.1; 0 takes any free one.
    browser
        Whether to open the page, where there is a screen.
    study
        The directory of an optimisation: its front is on the page, and dragging along it shows its designs.
    """
    try:
        from mirror_studio.web.server import BadPortError, serve
    except ModuleNotFoundError as error:
        if error.name not in ("starlette", "uvicorn", "websockets"):
            raise
        print(f"mirror-cad: the studio needs {error.name}: install the project with its extra \"studio\"", file=sys.stderr)
        return BAD_INPUT
    try:
        serve(port, browser, study)
    except BadPortError as error:
        print(f"mirror-cad: {error}", file=sys.stderr)
        return BAD_INPUT
    return DONE
