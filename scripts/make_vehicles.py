"""Model the vehicles and roadside objects of the driver's world and write them as GLB files.

A folder goes in (by default the package's assets), and names of models if not all are wanted; a file a model comes out.
The same bytes come out every time. ``vehicles/models.py`` holds the dimensions, ``vehicles/export.py`` says what the files
hold and how they lie in space.

Usage: ``python scripts/make_vehicles.py [--out FOLDER] [NAME …]``
"""

from __future__ import annotations

import argparse
from pathlib import Path

from vehicles.export import write_glb
from vehicles.models import MODELS

DEFAULT_FOLDER = Path(__file__).resolve().parents[1] / "raytrace" / "scene" / "assets"


def main() -> None:
    """Write the models named, or all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(MODELS)}")
    parser.add_argument("--out", type=Path, default=DEFAULT_FOLDER)
    arguments = parser.parse_args()
    unknown = sorted(set(arguments.names) - set(MODELS))
    if unknown:
        parser.error(f"no model is called {', '.join(unknown)}: the models are {', '.join(MODELS)}")
    for name in arguments.names or MODELS:
        path = arguments.out / f"{name}.glb"
        write_glb(path, MODELS[name]())
        print(f"{path}: {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
