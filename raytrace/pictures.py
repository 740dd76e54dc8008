"""A picture file in, its elements as 8-bit sRGB the right way up out: the only place where pictures of others are decoded."""

from __future__ import annotations

import io
import warnings
from typing import IO, TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import FileError

if TYPE_CHECKING:
    from PIL.Image import Image as Pillow

Picture = NDArray[np.uint8]

# Larger pictures hold more than any mirror shows, and would fill the memory when decoded.
MAX_PIXELS = 120_000_000


class Decoded(NamedTuple):
    """colours (h, w, 3) : sRGB.   alpha (h, w) : how much each element covers, None where all are whole."""

    colours: Picture
    alpha: Picture | None

    def over(self, background: NDArray[np.float64]) -> Picture:
        """The picture laid over a colour (3,), 0 … 255: coded values are mixed, as picture programs show it."""
        if self.alpha is None:
            return self.colours
        share = self.alpha[..., None] / 255.0
        return np.rint(share * self.colours + (1.0 - share) * background).astype(np.uint8)


class PictureError(Exception):
    """What is wrong with a picture, without its name."""


def read_picture(stream: IO[bytes], as_stored: bool = False) -> Decoded:
    """Decode the first picture of a file.

    As every viewer shows it: turned as its EXIF or XMP says, and an embedded ICC profile converted to sRGB (relative
    colorimetric, black point kept); without a profile sRGB is assumed. as_stored : neither, as glTF asks of its textures.
    Gray of 16 bits keeps its upper 8.

    Raises
    ------
    PictureError
    """
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of large pictures, and of tags that are damaged
            picture: Pillow = Image.open(stream)
            if picture.width * picture.height > MAX_PIXELS:
                raise PictureError(f"{picture.width} × {picture.height} elements are too many (at most {MAX_PIXELS // 10**6} "
                                   "million are read): scale the picture down")
            picture.load()
            profile = None if as_stored else picture.info.get("icc_profile")
            kind = picture.format
            if not as_stored:
                picture = _upright(picture)
            picture = _of_8_bits(picture, kind)
            alpha = None
            if picture.has_transparency_data:
                picture = picture.convert("RGBA")
                covered = np.array(picture.getchannel("A"), dtype=np.uint8)
                alpha = covered if (covered < 255).any() else None
                picture = picture.convert("RGB")
            return Decoded(np.array(_in_srgb(picture, profile), dtype=np.uint8), alpha)
    except PictureError:
        raise
    except Image.DecompressionBombError:
        raise PictureError(f"too many elements (at most {MAX_PIXELS // 10**6} million are read): scale the picture "
                           "down") from None
    except UnidentifiedImageError:
        raise PictureError("not a picture in a format that is read (PNG, JPEG, TIFF, WebP, BMP …)") from None
    except Exception as error:  # a damaged picture raises whatever its decoder meets first
        raise PictureError(f"the picture cannot be read: {error or type(error).__name__}") from None


def decoded(data: bytes, name: str, as_stored: bool = False) -> Decoded:
    """A picture from a file's bytes, as `read_picture`.

    Raises
    ------
    FileError
        With `name`.
    """
    try:
        return read_picture(io.BytesIO(data), as_stored)
    except PictureError as error:
        raise FileError(f"{name}: {error}") from None


def _upright(picture: Pillow) -> Pillow:
    from PIL import ExifTags, ImageOps

    try:
        if picture.getexif().get(ExifTags.Base.Orientation, 1) == 1:  # of which Pillow would make a copy
            return picture
        return ImageOps.exif_transpose(picture)
    except Exception:  # damaged tags say nothing of a picture that is whole
        return picture


def _of_8_bits(picture: Pillow, kind: str | None) -> Pillow:
    """Gray of 16 bits as gray of 8: Pillow would cut its values off at 255."""
    from PIL import Image

    if picture.mode.startswith("I;16"):
        return Image.fromarray((np.asarray(picture, dtype=np.uint16) >> 8).astype(np.uint8))
    if picture.mode == "I" and kind == "PPM":  # which Pillow spreads over 0 … 65535 by the file's largest value
        return Image.fromarray((np.asarray(picture, dtype=np.int64) >> 8).astype(np.uint8))
    if picture.mode in ("I", "F"):
        raise PictureError("values of 32 bits have no agreed white: save the picture with 8 or 16 bits")
    return picture


def _in_srgb(picture: Pillow, profile: bytes | None) -> Pillow:
    """The picture in RGB, from its profile's colours where it has one."""
    from PIL import ImageCms

    if picture.mode not in ("RGB", "L", "CMYK", "LAB"):
        picture = picture.convert("RGB")
    if not profile:
        return picture if picture.mode == "RGB" else picture.convert("RGB")
    try:
        own = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        space = own.profile.xcolor_space.strip()
        if {"GRAY": "L"}.get(space, space) != picture.mode.upper():
            if picture.mode == "L":
                picture = picture.convert("RGB")
            if space != picture.mode:  # a profile of other colours than the picture's is none of its own
                return picture.convert("RGB")
        if "srgb" in ImageCms.getProfileDescription(own).lower():
            return picture.convert("RGB")
        converted = ImageCms.profileToProfile(
            picture, own, ImageCms.createProfile("sRGB"), renderingIntent=ImageCms.Intent.RELATIVE_COLORIMETRIC,
            outputMode="RGB", flags=ImageCms.Flags.BLACKPOINTCOMPENSATION)
    except (ImageCms.PyCMSError, OSError, ValueError) as error:
        raise PictureError(f"its colour profile cannot be used ({error}): save the picture as sRGB") from None
    assert converted is not None  # only a conversion in place returns nothing
    return converted
