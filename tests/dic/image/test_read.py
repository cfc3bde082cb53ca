import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image, ImageOps

from dic.errors import ImageError, ImageWarning
from dic.image.container import Container, Damage, require_bounded
from dic.image.read import read_image, require_same_size


def _grey(depth: type = np.uint8, shape: tuple[int, int] = (90, 120)) -> np.ndarray:
    return np.random.default_rng(3).integers(0, np.iinfo(depth).max, shape).astype(depth)


@pytest.mark.parametrize("suffix", ["png", "tif", "bmp"])
def test_eight_bits_are_read_as_stored(tmp_path: Path, suffix: str) -> None:
    grey = _grey()
    Image.fromarray(grey).save(tmp_path / f"a.{suffix}")

    image = read_image(tmp_path / f"a.{suffix}")

    assert image.dtype == np.float32
    assert np.array_equal(image, grey)


@pytest.mark.parametrize("suffix", ["png", "tif"])
def test_sixteen_bits_keep_their_depth(tmp_path: Path, suffix: str) -> None:
    grey = _grey(np.uint16)
    Image.fromarray(grey).save(tmp_path / f"a.{suffix}")

    assert np.array_equal(read_image(tmp_path / f"a.{suffix}"), grey)


@pytest.mark.parametrize(("kind", "largest"), [(np.uint8, 255), (np.uint16, 65535)])
def test_grey_levels_may_keep_the_type_of_the_file(tmp_path: Path, kind: type, largest: int) -> None:
    image = np.random.default_rng(8).integers(0, largest, (40, 50)).astype(kind)
    path = tmp_path / "image.tif"
    assert cv2.imwrite(str(path), image)
    stored = read_image(path, stored=True)
    assert stored.dtype == kind
    np.testing.assert_array_equal(stored, image)
    assert read_image(path).dtype == np.float32


@pytest.mark.parametrize("compression", ["tiff_lzw", "tiff_adobe_deflate", "packbits"])
def test_compressed_tiffs_are_read(tmp_path: Path, compression: str) -> None:
    grey = _grey()
    Image.fromarray(grey).save(tmp_path / "a.tif", compression=compression)

    assert np.array_equal(read_image(tmp_path / "a.tif"), grey)


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "P"])
def test_colour_becomes_luma(tmp_path: Path, mode: str) -> None:
    colours = np.zeros((64, 64, 3), np.uint8)
    colours[:, :16], colours[:, 16:32], colours[:, 32:48] = (200, 0, 0), (0, 200, 0), (0, 0, 200)
    Image.fromarray(colours).convert(mode, palette=Image.Palette.ADAPTIVE).save(tmp_path / "a.png")

    image = read_image(tmp_path / "a.png")

    # red, green and blue weigh 0.299, 0.587 and 0.114 (ITU-R BT.601)
    assert image[0, ::16] == pytest.approx([59.8, 117.4, 22.8, 0.0], abs=1e-3)


def test_grey_stored_as_colour_keeps_its_levels(tmp_path: Path) -> None:
    grey = _grey(np.uint16)
    cv2.imwrite(str(tmp_path / "a.png"), cv2.merge([grey, grey, grey]))

    assert np.allclose(read_image(tmp_path / "a.png"), grey, atol=0.01)


@pytest.mark.parametrize("suffix", ["png", "tif", "bmp"])
@pytest.mark.parametrize("share", [0.0, 0.002, 0.3, 0.7, 0.99])
def test_a_file_that_was_cut_off_is_refused(
    tmp_path: Path, suffix: str, share: float, capfd: pytest.CaptureFixture[str]
) -> None:
    whole = tmp_path / f"whole.{suffix}"
    Image.fromarray(_grey()).save(whole)
    content = whole.read_bytes()
    cut = tmp_path / f"cut.{suffix}"
    cut.write_bytes(content[: int(share * len(content))])

    with pytest.raises(ImageError, match=r"cut\..*(cut off|empty|another kind)"):
        read_image(cut)
    assert capfd.readouterr() == ("", "")


def test_a_tiff_whose_directory_comes_first_is_refused_when_its_pixels_are_cut_off(tmp_path: Path) -> None:
    strip = _grey().tobytes()
    tags = [
        (256, 120),
        (257, 90),
        (258, 8),
        (259, 1),
        (262, 1),
        (273, 134),
        (277, 1),
        (278, 90),
        (279, len(strip)),
    ]
    entries = b"".join(
        np.array([tag, 4], "<u2").tobytes() + np.array([1, v], "<u4").tobytes() for tag, v in tags
    )
    header = b"II*\0" + np.array([8], "<u4").tobytes() + np.array([len(tags)], "<u2").tobytes() + entries
    whole = header.ljust(134, b"\0") + strip
    (tmp_path / "whole.tif").write_bytes(whole)
    (tmp_path / "cut.tif").write_bytes(whole[:-500])

    assert np.array_equal(read_image(tmp_path / "whole.tif"), _grey())
    with pytest.raises(ImageError, match="cut off"):
        read_image(tmp_path / "cut.tif")


def test_a_damaged_png_is_refused_in_silence(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    Image.fromarray(_grey()).save(tmp_path / "a.png")
    content = bytearray((tmp_path / "a.png").read_bytes())
    content[len(content) // 2] ^= 0xFF
    (tmp_path / "a.png").write_bytes(content)

    with pytest.raises(ImageError, match="damaged"):
        read_image(tmp_path / "a.png")
    assert capfd.readouterr() == ("", "")


def test_a_deflated_tiff_with_wrong_pixels_is_refused(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    Image.fromarray(_grey()).save(tmp_path / "a.tif", compression="tiff_adobe_deflate")
    content = bytearray((tmp_path / "a.tif").read_bytes())
    content[len(content) // 2] ^= 0xFF
    (tmp_path / "a.tif").write_bytes(content)

    with pytest.raises(ImageError, match="damaged pixels"):
        read_image(tmp_path / "a.tif")
    assert capfd.readouterr() == ("", "")


def test_what_is_no_image_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_text("just text")

    with pytest.raises(ImageError, match="another kind of file"):
        read_image(tmp_path / "a.png")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ImageError, match=r"absent\.png: read image: .*No such file"):
        read_image(tmp_path / "absent.png")


def test_a_tiny_image_is_refused(tmp_path: Path) -> None:
    Image.fromarray(_grey(shape=(20, 200))).save(tmp_path / "a.png")

    with pytest.raises(ImageError, match="200 × 20 px"):
        read_image(tmp_path / "a.png")


def test_pixels_that_are_not_finite_are_refused(tmp_path: Path) -> None:
    grey = _grey().astype(np.float32)
    grey[5, 5] = np.nan
    Image.fromarray(grey).save(tmp_path / "a.tif")

    with pytest.raises(ImageError, match="NaN"):
        read_image(tmp_path / "a.tif")


@pytest.mark.parametrize("marker", [-9999.0, -32768.0, 65535.0])
def test_value_that_marks_missing_pixels_is_named(tmp_path, marker):
    grey = np.random.default_rng(1).uniform(20.0, 230.0, (60, 60)).astype(np.float32)
    grey[10:14, 20:24] = marker
    Image.fromarray(grey).save(tmp_path / "a.tif")
    with pytest.raises(ImageError, match=f"pixels of {marker:g}, far from all others, which seem to mark"):
        read_image(tmp_path / "a.tif")


def test_dark_background_two_levels_and_single_dead_pixels_mark_nothing_missing(tmp_path):
    rng = np.random.default_rng(1)
    background = rng.uniform(150.0, 230.0, (60, 60))
    background[:, :20] = 0.0
    two_levels = np.where(rng.uniform(size=(60, 60)) < 0.5, 0.0, 1.0)
    dead = rng.uniform(20.0, 230.0, (60, 60))
    dead[3, 3] = dead[7, 9] = 5000.0
    for grey in (background, two_levels, dead):
        Image.fromarray(grey.astype(np.float32)).save(tmp_path / "a.tif")
        assert read_image(tmp_path / "a.tif").shape == (60, 60)


def test_images_of_different_size_are_refused() -> None:
    images = [np.zeros((50, 60)), np.zeros((50, 60)), np.zeros((50, 61))]

    with pytest.raises(ImageError, match=r"c: .*60 × 50 px like a, got 61 × 50 px"):
        require_same_size(images, ["a", "b", "c"])
    require_same_size(images[:2], ["a", "b"])


@pytest.mark.parametrize("level", [1e30, -1e10, 1e300])
def test_levels_that_no_arithmetic_survives_are_refused(tmp_path: Path, level: float) -> None:
    grey = np.full((64, 64), 100.0)
    grey[5, 5] = level
    cv2.imwrite(str(tmp_path / "huge.tif"), grey)
    with pytest.raises(ImageError, match="beyond"):
        read_image(tmp_path / "huge.tif")


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _png(width: int, height: int, pixels: bytes, *others: bytes) -> bytes:
    header = _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + b"".join(others) + _chunk(b"IDAT", pixels) + _chunk(b"IEND", b"")


@pytest.mark.parametrize(
    ("width", "height", "got"),
    [(2**31 - 1, 2**31 - 1, "megapixels"), (12_000, 12_000, "no camera"), (0, 50, "no pixels")],
)
def test_a_declared_size_that_no_camera_has_is_refused_before_decoding(
    tmp_path: Path, width: int, height: int, got: str
) -> None:
    (tmp_path / "bomb.png").write_bytes(_png(width, height, zlib.compress(b"\0" * 1000)))

    with pytest.raises(ImageError, match=got):
        read_image(tmp_path / "bomb.png")


_WHOLE = zlib.compress(b"\0" * 65 * 64)
"""The pixels of a black image of 64 × 64 px; each row begins with the number of its filter."""


@pytest.mark.parametrize(
    "pixels",
    [
        b"\x78\x9cgarbage",
        b"",
        zlib.compress(b"\0" * (65 * 64 - 1)),  # the last pixel is missing
        _WHOLE[:-4],  # no checksum
        _WHOLE[:-1] + bytes([_WHOLE[-1] ^ 1]),  # a wrong checksum
        zlib.compress(b"\x09" + b"\0" * (65 * 64 - 1)),  # there is no filter 9
    ],
)
def test_pixels_that_are_damaged_or_missing_are_refused_without_a_word_of_the_decoder(
    tmp_path: Path, pixels: bytes, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.png").write_bytes(_png(64, 64, pixels))

    with pytest.raises(ImageError, match="pixels"):
        read_image(tmp_path / "a.png")
    assert capfd.readouterr() == ("", "")


def test_a_wrong_colour_profile_changes_nothing_and_prints_nothing(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    grey = _grey(shape=(64, 64))
    rows = zlib.compress(b"".join(b"\0" + row.tobytes() for row in grey))
    profile = _chunk(b"iCCP", b"x\0\0" + zlib.compress(b"none"))
    (tmp_path / "a.png").write_bytes(_png(64, 64, rows, profile))

    assert np.array_equal(read_image(tmp_path / "a.png"), grey)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("orientation", range(2, 9))
@pytest.mark.parametrize("suffix", ["tif", "png"])
def test_a_tag_of_orientation_is_obeyed_and_said_aloud(tmp_path: Path, suffix: str, orientation: int) -> None:
    path, exif = tmp_path / f"a.{suffix}", Image.Exif()
    exif[274] = orientation
    for suffix_ in (suffix, "png"):
        Image.fromarray(_grey()).save(tmp_path / f"a.{suffix_}", exif=exif)
    # Pillow turns a PNG only here; of a TIFF it may have turned the pixels already.
    upright = ImageOps.exif_transpose(Image.open(tmp_path / "a.png"))

    with pytest.warns(ImageWarning, match=rf"orientation says \({orientation}\)"):
        image = read_image(path)
    assert np.array_equal(image, np.asarray(upright))


def test_large_real_sizes_are_accepted() -> None:
    # 151 megapixels of 16 bit, the largest area sensor on sale
    image = Container(b"", 14204, 10652, 16)
    require_bounded(image, file_bytes=14204 * 10652 * 2 // 3)
    with pytest.raises(Damage, match="no camera"):
        require_bounded(image, file_bytes=10_000)
