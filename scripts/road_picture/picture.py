"""The picture as a whole: a path goes in, the rendered scene of road, traffic and roadside comes out as a JPEG there."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image

from .camera import BEYOND, ROAD, Window
from .cars import car
from .commercial import truck, van
from .fittings import plate
from .ground import OWN_LANE_LINE, REFERENCE_LINE
from .light import encoded
from .materials import BLUE_PAINT, GREEN_PAINT, RED_PAINT
from .maths import Array
from .render import Scene
from .roadside import column, forest, guard_rail
from .textures import make_textures

BAND_ROWS = 45
SEED = 2014
MAX_BYTES = 1_000_000
JPEG_QUALITIES = (93, 92, 91, 90, 89, 88, 86, 84, 82, 80)


def build_scene() -> Scene:
    """The road's furniture and traffic."""
    rng = np.random.default_rng(SEED)
    textures = make_textures(rng)
    beyond, between = REFERENCE_LINE + 1.75, OWN_LANE_LINE + 1.75  # lane centres, beyond and before the reference line
    parts = [
        *car(beyond, 8.6, GREEN_PAINT, 0.012, (1.0, 1.0, 1.0)),
        plate(beyond, 8.578, 0.44),
        *car(beyond - 0.1, 23.0, RED_PAINT, 0.03, (1.03, 1.10, 1.02)),
        *van(beyond, 38.0),
        *truck(beyond + 0.1, 58.0),
        # So far back and so close to its lane's edge that it hides the reference line only at X > 1950.
        *car(between - 0.55, 96.0, BLUE_PAINT, 0.05, (1.0, 1.0, 1.0)),
        column(textures.patchy),
        guard_rail(),
        *forest(rng, textures.patchy),
    ]
    return Scene(parts, textures)


def save(pixels: Array, path: Path) -> None:
    """Write the JPEG at the best quality that stays below MAX_BYTES."""
    image = Image.fromarray(pixels)
    for quality in JPEG_QUALITIES:
        buffer = BytesIO()
        image.save(buffer, "JPEG", quality=quality, subsampling=0, optimize=True)
        if len(buffer.getvalue()) < MAX_BYTES:
            path.write_bytes(buffer.getvalue())
            return
    raise RuntimeError(f"the picture takes more than {MAX_BYTES} bytes at every quality tried")


def write_pictures(road: Path, beyond: Path) -> None:
    """Render the road and what it goes on to, band by band, and save them."""
    scene = build_scene()
    for window, path in ((ROAD, road), (BEYOND, beyond)):
        write_picture(scene, window, path)


def write_picture(scene: Scene, window: Window, path: Path) -> None:
    """Render one window of the scene and save it."""
    bands = [scene.render_band(window, row, min(BAND_ROWS, window.rows - row)) for row in range(0, window.rows, BAND_ROWS)]
    save(encoded(np.concatenate(bands)), path)
