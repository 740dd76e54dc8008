"""Render the built-in reference picture: the road as a rear-facing camera on a truck's left side sees it.

A path goes in (by default the package's asset), the picture comes out as a JPEG file there.  The same bytes come out
every time.  ``road_picture/camera.py`` says how the picture lies in the scene, ``road_picture/ground.py`` where the
line is that distortion is measured on, and ``road_picture/picture.py`` what stands where.

Usage: ``python scripts/make_road_picture.py [OUT.jpg]``
"""

from __future__ import annotations

import sys
from pathlib import Path

from road_picture.picture import write_picture

DEFAULT_OUTPUT = Path(__file__).resolve().parents[1] / "raytrace" / "scene" / "assets" / "road.jpg"


def main(arguments: list[str]) -> None:
    """Render the picture to the path given, or to the package's asset."""
    write_picture(Path(arguments[0]) if arguments else DEFAULT_OUTPUT)


if __name__ == "__main__":
    main(sys.argv[1:])
