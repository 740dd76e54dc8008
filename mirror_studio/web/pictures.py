"""The picture on the plane as the page shows it, finely, as PNG."""

from __future__ import annotations

import io
import math

import numpy as np

from mirror_cad.spec import MirrorSpec
from mirror_studio.web.engine import FINE_SAMPLES, designed, eyes_of, mirrors_in_view
from mirror_studio.web.mirror_pose import MirrorPose
from mirror_studio.web.protocol import LARGEST_PICTURE, ViewSettings
from raytrace.image import photograph
from raytrace.reflector import Reflector
from raytrace.viewing.camera import Frame

GAP = 12  # pixels of white between two pictures
WHITE = 255
SMALLEST_PICTURE = 16  # pixels, as a specification may ask for


def driver_picture(spec: MirrorSpec, look: ViewSettings, users_mirror: Reflector | None) -> bytes:
    """The design turned as `look` has it, seen by one eye or both, beside the user's mirror if there is one.

    The design's pictures are spec.view.width_px wide, the user's mirror's of the same scale; where that would be wider than a
    picture may be, all are smaller. Raises: MirrorError.
    """
    from PIL import Image

    one = designed(spec)
    turn = MirrorPose(math.radians(look.yaw_deg), math.radians(look.pitch_deg))
    scene = one.setup.scene(one.picture, spec)
    seen = mirrors_in_view(one, turn, users_mirror)
    wide = {box: Frame.around(box, 1).pixel for _, _, box in seen}  # mm
    pixel = max(wide[one.mirror.box] / spec.view.width_px, max(wide.values()) / LARGEST_PICTURE)
    frames = {box: Frame.around(box, max(SMALLEST_PICTURE, round(wide[box] / pixel))) for box in wide}
    views = [photograph(reflector, frames[box].camera(each.to_mirror(eye)), each.seen_by(scene), None, FINE_SAMPLES)[0]
             for reflector, each, box in seen for eye in eyes_of(one.setup.eye, look)]
    height = max(view.shape[0] for view in views)
    width = sum(view.shape[1] for view in views) + GAP * (len(views) - 1)
    sheet, left = np.full((height, width, 3), WHITE, dtype=np.uint8), 0
    for view in views:
        sheet[:view.shape[0], left:left + view.shape[1]] = view
        left += view.shape[1] + GAP
    stream = io.BytesIO()
    Image.fromarray(sheet).save(stream, format="PNG", compress_level=4)
    return stream.getvalue()
