"""Render the built-in reference pictures: the road as a rear-facing camera on a truck's left side sees it, and a coarser one
that reaches beyond it.

A folder goes in (by default the package's assets), ``road.jpg`` and ``road-beyond.jpg`` come out there.  The same bytes come
out every time.  ``road_picture/camera.py`` says how the pictures lie in the scene, ``road_picture/ground.py`` where the
line is that distortion is measured on, and ``road_picture/picture.py`` what stands where.

Usage: ``python scripts/make_road_picture.py [FOLDER]``
"""

from __future__ import annotations

import sys
from pathlib import Path

from road_picture.picture import write_pictures

ASSETS = Path(__file__).resolve().parents[1] / "raytrace" / "scene" / "assets"


def main(arguments: list[str]) -> None:
    """Render the pictures into the folder given, or the package's assets."""
    folder = Path(arguments[0]) if arguments else ASSETS
    write_pictures(folder / "road.jpg", folder / "road-beyond.jpg")


if __name__ == "__main__":
    main(sys.argv[1:])
