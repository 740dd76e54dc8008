"""Pictures of others: the right way up, in sRGB, with what is transparent laid over what lies beside."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageCms

import mirror_cad
from mirror_studio.viewing_setup import ViewingSetup
from raytrace import Reflector
from raytrace.errors import SceneError
from raytrace.image import photograph
from raytrace.pictures import PictureError, decoded, read_picture
from raytrace.scene.reference import BESIDE, load_picture
from raytrace.viewing.camera import Frame
from tests.conftest import constant, spec_of

ORIENTATION = 0x112  # the EXIF tag
# What each of its values says was done to the upright picture before it was stored (EXIF 2.3, 4.6.4).
STORED = {1: None, 2: Image.Transpose.FLIP_LEFT_RIGHT, 3: Image.Transpose.ROTATE_180, 4: Image.Transpose.FLIP_TOP_BOTTOM,
          5: Image.Transpose.TRANSPOSE, 6: Image.Transpose.ROTATE_90, 7: Image.Transpose.TRANSVERSE,
          8: Image.Transpose.ROTATE_270}
# EXIF says where the stored rows and columns belong: 6, "row 0 is the right side", is stored turned to the left.
LOSSLESS = {"PNG": {}, "WEBP": {"lossless": True}, "JPEG": {"quality": 100, "subsampling": 0}}


def landscape() -> Image.Image:
    """Sky above, road below, and a post at the left."""
    upright = Image.new("RGB", (48, 32), (90, 150, 230))
    upright.paste((110, 110, 110), (0, 16, 48, 32))
    upright.paste((250, 40, 40), (0, 0, 8, 32))
    return upright


def stored(picture: Image.Image, kind: str, **extra: object) -> bytes:
    stream = io.BytesIO()
    picture.save(stream, kind, **extra)
    return stream.getvalue()


def read(data: bytes, as_stored: bool = False) -> np.ndarray:
    return read_picture(io.BytesIO(data), as_stored).colours


@pytest.mark.parametrize("orientation", STORED)
@pytest.mark.parametrize("kind", LOSSLESS)
def test_a_picture_that_was_stored_lying_is_read_upright(tmp_path: Path, kind: str, orientation: int) -> None:
    """Phones store what the sensor has, and a tag. All eight tags, in every format that has EXIF."""
    upright, how = landscape(), STORED[orientation]
    lying = upright if how is None else upright.transpose(how)
    exif = Image.Exif()
    exif[ORIENTATION] = orientation
    path = tmp_path / "phone"
    path.write_bytes(stored(lying, kind, exif=exif, **LOSSLESS[kind]))
    assert load_picture(path).shape == (32, 48, 3)
    assert np.abs(load_picture(path).astype(int) - np.asarray(upright)).max() <= (40 if kind == "JPEG" else 0)
    # glTF takes its textures as they are stored.
    assert read(path.read_bytes(), as_stored=True).shape == np.asarray(lying).shape


def test_an_orientation_in_xmp_alone_counts_and_a_damaged_tag_does_not() -> None:
    lying = landscape().transpose(STORED[6])
    xmp = (b'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
           b'<rdf:Description xmlns:tiff="http://ns.adobe.com/tiff/1.0/" tiff:Orientation="6"/></rdf:RDF></x:xmpmeta>')
    assert read(stored(lying, "WEBP", xmp=xmp, lossless=True)).shape == (32, 48, 3)
    for exif in (b"Exif\0\0II*\0\xff\xff\xff\xff", b"Exif\0\0", b"nonsense"):
        assert read(stored(lying, "PNG", exif=exif)).shape == (48, 32, 3)


def pgm(values: np.ndarray, largest: int) -> bytes:
    return f"P5\n{values.shape[1]} {values.shape[0]}\n{largest}\n".encode() + values.astype(">u2").tobytes()


def test_gray_of_16_bits_keeps_its_upper_8_in_every_format(tmp_path: Path) -> None:
    """PGM (whose largest value is its own), plain PGM, PNG and TIFF of either byte order; floats have no agreed white."""
    values = np.linspace(0, 65535, 48).round().astype(np.uint16).reshape(6, 8)
    upper = np.repeat((values >> 8).astype(np.uint8)[..., None], 3, axis=2)
    path = tmp_path / "gray.pgm"
    path.write_bytes(pgm(values, 65535))
    assert np.array_equal(load_picture(path), upper)
    plain = "P2\n8 6\n65535\n" + " ".join(map(str, values.ravel().tolist())) + "\n"
    for data in (plain.encode(), stored(Image.fromarray(values), "PNG"), stored(Image.fromarray(values), "TIFF"),
                 stored(Image.fromarray(values.astype(">u2")), "TIFF")):
        assert np.array_equal(read(data), upper)
    # Ten bits: 1023 is white.
    ten = read(pgm(values >> 6, 1023))
    assert np.abs(ten.astype(int) - upper).max() <= 1
    with pytest.raises(PictureError, match="values of 32 bits have no agreed white: save the picture with 8 or 16 bits"):
        read(stored(Image.fromarray(values.astype(np.float32)), "TIFF"))


def test_what_is_transparent_shows_what_lies_beside_the_picture(tmp_path: Path) -> None:
    """Half and fully transparent, as PNG with and without colours, palette and a colour that counts as none."""
    picture = np.full((4, 6, 4), [200, 100, 50, 255], dtype=np.uint8)
    picture[:, 2:4, 3], picture[:, 4:, 3] = 128, 0
    path = tmp_path / "cut.png"
    path.write_bytes(stored(Image.fromarray(picture), "PNG"))
    shown = load_picture(path)
    assert (shown[:, :2] == [200, 100, 50]).all()
    half = 128.0 / 255.0
    assert (shown[:, 2:4] == np.rint(half * np.array([200, 100, 50]) + (1.0 - half) * BESIDE)).all()
    assert (shown[:, 4:] == np.rint(BESIDE)).all()
    gray = Image.fromarray(picture[..., [0, 3]], "LA")
    (tmp_path / "gray.png").write_bytes(stored(gray, "PNG"))
    assert (load_picture(tmp_path / "gray.png")[:, 4:] == np.rint(BESIDE)).all()
    two = Image.new("P", (2, 1))
    two.putpalette([10, 20, 30, 200, 200, 200])
    two.putdata([0, 1])
    (tmp_path / "two.gif").write_bytes(stored(two, "GIF", transparency=1))
    assert load_picture(tmp_path / "two.gif")[0].tolist() == [[10, 20, 30], np.rint(BESIDE).tolist()]
    # A texture's cover is kept apart: what to do with it, its material says.
    texture = decoded(path.read_bytes(), "leaf")
    assert texture.alpha is not None
    assert np.array_equal(texture.alpha, picture[..., 3])
    assert (texture.colours == [200, 100, 50]).all()


def profile(primaries: np.ndarray, gamma: float) -> bytes:
    """An ICC 2 profile of a display: its primaries in XYZ (D50) as columns, one gamma. Written out after ICC.1:2001-04."""
    def fixed(value: float) -> bytes:
        return struct.pack(">i", round(value * 65536.0))

    tags = {b"desc": b"desc\0\0\0\0" + struct.pack(">I", 5) + b"test\0" + bytes(78), b"cprt": b"text\0\0\0\0none\0",
            b"wtpt": b"XYZ \0\0\0\0" + b"".join(map(fixed, (0.9642, 1.0, 0.8249)))}
    for name, column in zip((b"rXYZ", b"gXYZ", b"bXYZ"), primaries.T, strict=True):
        tags[name] = b"XYZ \0\0\0\0" + b"".join(fixed(v) for v in column)
    for name in (b"rTRC", b"gTRC", b"bTRC"):
        tags[name] = b"curv\0\0\0\0" + struct.pack(">IH", 1, round(gamma * 256.0))
    table, body, at = b"", b"", 128 + 4 + 12 * len(tags)
    for name, data in tags.items():
        table += name + struct.pack(">II", at + len(body), len(data))
        body += data + bytes(-len(data) % 4)
    size = at + len(body)
    header = (struct.pack(">I4sI4s4s4s", size, b"test", 0x02100000, b"mntr", b"RGB ", b"XYZ ") + bytes(12) + b"acsp" + bytes(28)
              + b"".join(map(fixed, (0.9642, 1.0, 0.8249))))
    return header + bytes(128 - len(header)) + struct.pack(">I", len(tags)) + table + body


SRGB_TO_XYZ = np.array([[0.4360747, 0.3850649, 0.1430804], [0.2225045, 0.7168786, 0.0606169],
                        [0.0139322, 0.0971045, 0.7141733]])  # at D50: B. Lindbloom
ADOBE_TO_XYZ = np.array([[0.6097559, 0.2052401, 0.1492240], [0.3111242, 0.6256560, 0.0632197],
                         [0.0194811, 0.0608902, 0.7448387]])


def in_srgb(values: np.ndarray, primaries: np.ndarray, gamma: float) -> np.ndarray:
    """Closed form of the conversion: decode, primaries to primaries, encode."""
    light = np.clip((values / 255.0) ** gamma @ primaries.T @ np.linalg.inv(SRGB_TO_XYZ).T, 0.0, 1.0)
    coded = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1.0 / 2.4) - 0.055)
    return 255.0 * coded


@pytest.mark.parametrize("kind", ["PNG", "TIFF", "WEBP"])
def test_a_picture_with_a_colour_profile_is_converted_to_srgb(kind: str) -> None:
    """Adobe RGB, as cameras and picture agencies use it, against the closed form; darker than 1/100 its rounding grows."""
    values = np.random.default_rng(5).integers(40, 256, (16, 16, 3), dtype=np.uint8)
    icc = profile(ADOBE_TO_XYZ, 2.19921875)
    extra = {"lossless": True} if kind == "WEBP" else {}
    found = read(stored(Image.fromarray(values), kind, icc_profile=icc, **extra))
    expected = in_srgb(values.astype(float), ADOBE_TO_XYZ, 2.19921875)
    assert np.abs(found - expected).max() <= 2.0
    assert np.abs(expected - values).max() > 20.0  # so much it would have been off
    # glTF asks that profiles of its textures be ignored.
    assert np.array_equal(read(stored(Image.fromarray(values), kind, icc_profile=icc, **extra), as_stored=True), values)


def test_srgb_stays_as_it_is_a_profile_of_other_colours_is_none_and_a_broken_one_is_said(tmp_path: Path) -> None:
    values = np.random.default_rng(6).integers(0, 256, (8, 8, 3), dtype=np.uint8)
    srgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    assert np.array_equal(read(stored(Image.fromarray(values), "PNG", icc_profile=srgb)), values)
    gray = values[..., 0]
    assert np.array_equal(read(stored(Image.fromarray(gray), "PNG", icc_profile=srgb))[..., 1], gray)
    path = tmp_path / "broken.png"
    path.write_bytes(stored(Image.fromarray(values), "PNG", icc_profile=b"no profile"))
    with pytest.raises(SceneError, match=r"broken\.png: its colour profile cannot be used .*save the picture as sRGB"):
        load_picture(path)


def test_a_phone_s_picture_is_upright_in_the_mirror(tmp_path: Path) -> None:
    """The case as it was met: sky above, road below, stored turned with tag 6; the mirror shows what it shows of the upright
    file."""
    upright = Image.new("RGB", (400, 300), (90, 150, 230))
    upright.paste((110, 110, 110), (0, 150, 400, 300))
    exif = Image.Exif()
    exif[ORIENTATION] = 6
    upright.transpose(Image.Transpose.ROTATE_90).save(tmp_path / "phone.png", exif=exif)
    upright.save(tmp_path / "upright.png")
    mirror = mirror_cad.design(spec_of(constant(1250.0), constant(1250.0)))
    setting = ViewingSetup.of(mirror.spec, mirror.box)
    camera = Frame.around(mirror.box, 120).camera(setting.eye)
    views = [photograph(Reflector.from_mirror(mirror), camera, setting.scene(load_picture(tmp_path / name), mirror.spec),
                        samples=1)[0] for name in ("phone.png", "upright.png")]
    assert np.array_equal(*views)
