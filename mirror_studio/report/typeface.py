"""Open the typeface that pictures with words in them are lettered in."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

from PIL import ImageFont


def typeface(name: str, size: int) -> ImageFont.FreeTypeFont:
    """A face of the files that matplotlib brings along, so that a picture looks the same wherever it is made.

    Parameters
    ----------
    name
        Of the file, as DejaVuSans.ttf.
    size
        px.
    """
    package = find_spec("matplotlib")  # found, and not loaded: that takes half a second
    if package is None or package.origin is None:
        raise ModuleNotFoundError("matplotlib is not installed", name="matplotlib")
    return ImageFont.truetype(str(Path(package.origin).parent / "mpl-data" / "fonts" / "ttf" / name), size)
