"""Tests with JPEG, PGM and PPM files that Pillow or the test itself has written."""

import io
import os
import re
import warnings

import cv2
import numpy as np
import pytest
from PIL import Image, ImageOps

from dic.errors import ImageError, ImageWarning, each_warning_once
from dic.image.read import read_image

NOISE = np.random.default_rng(8)
SMOOTH = 90 + 60 * np.sin(np.arange(120) / 9.0) * np.cos(np.arange(90) / 7.0)[:, None]


@pytest.fixture
def jpeg(tmp_path):
    """The path of a JPEG file, and the grey levels that Pillow decodes from the file."""
    Image.fromarray(SMOOTH.astype(np.uint8)).save(tmp_path / "a.jpg", quality=92)
    return tmp_path / "a.jpg", np.asarray(Image.open(tmp_path / "a.jpg"))


def test_jpeg_is_read_and_the_warning_says_what_compression_does(jpeg):
    path, decoded = jpeg
    with pytest.warns(ImageWarning, match=r"a\.jpg: is compressed as JPEG, which changes the grey"):
        image = read_image(path)
    assert np.array_equal(image, decoded)


def test_colour_jpeg_becomes_luma(tmp_path):
    """Red, green and blue weigh 0.299, 0.587 and 0.114; compression of even areas costs up to two levels."""
    colours = np.zeros((64, 96, 3), np.uint8)
    colours[:, :32], colours[:, 32:64], colours[:, 64:] = (200, 0, 0), (0, 200, 0), (0, 0, 200)
    Image.fromarray(colours).save(tmp_path / "a.jpg", quality=98, subsampling=0)
    with pytest.warns(ImageWarning):
        image = read_image(tmp_path / "a.jpg")
    assert image[32, [16, 48, 80]] == pytest.approx([59.8, 117.4, 22.8], abs=2.0)


@pytest.mark.parametrize("orientation", range(2, 9))
def test_a_tag_of_orientation_in_a_jpeg_is_obeyed_and_said_aloud(tmp_path, orientation):
    exif = Image.Exif()
    exif[274] = orientation
    Image.fromarray(SMOOTH.astype(np.uint8)).save(tmp_path / "a.jpg", exif=exif)
    upright = ImageOps.exif_transpose(Image.open(tmp_path / "a.jpg"))
    with pytest.warns(ImageWarning) as said:
        image = read_image(tmp_path / "a.jpg")
    assert np.array_equal(image, np.asarray(upright))
    assert any(f"orientation says ({orientation})" in str(each.message) for each in said)


@pytest.mark.parametrize("share", [0.0, 0.002, 0.1, 0.5, 0.999])
@pytest.mark.filterwarnings("ignore::dic.errors.ImageWarning")
def test_a_jpeg_that_was_cut_off_is_refused_in_silence(jpeg, share, capfd):
    path, _ = jpeg
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(ImageError, match=r"cut off|empty|another kind"):
        read_image(path)
    assert capfd.readouterr() == ("", "")


def test_damaged_pixels_of_a_jpeg_are_refused_and_libjpeg_prints_nothing(tmp_path, capfd):
    """libjpeg fills what it cannot decode with grey; the message that it prints becomes the refusal."""
    picture = NOISE.integers(0, 255, (90, 120)).astype(np.uint8)
    Image.fromarray(picture).save(tmp_path / "a.jpg", quality=95)
    content = (tmp_path / "a.jpg").read_bytes()
    half = len(content) // 2
    # a marker within the coded pixels ends a run of zero bits and leaves the rest undecodable
    (tmp_path / "a.jpg").write_bytes(content[:half] + b"\xff\xd3" + content[half + 600 :])
    with pytest.raises(ImageError, match=r"a JPEG with damaged pixels \(Corrupt JPEG data"):
        read_image(tmp_path / "a.jpg")
    assert capfd.readouterr() == ("", "")


def jpeg_of(picture, **options):
    file = io.BytesIO()
    Image.fromarray(picture.astype(np.uint8)).save(file, "jpeg", quality=95, **options)
    return bytearray(file.getvalue())


def with_an_unknown_transform_of_colours():
    content = jpeg_of(np.dstack([SMOOTH] * 3))
    tables = content.index(b"\xff\xdb")
    # an APP14 segment in the place of the JFIF segment (Adobe technical note 5116)
    return content[:2] + b"\xff\xee\x00\x0eAdobe\x00\x64\0\0\0\0\x09" + content[tables:]


def with_a_repeated_scan():
    content = jpeg_of(SMOOTH, progressive=True)
    _, second, third, *_ = [found.start() for found in re.finditer(rb"\xff\xda", content)]
    return content[:third] + content[second:third] + content[third:]


def with_an_unknown_revision_of_jfif():
    content = jpeg_of(SMOOTH)
    content[content.index(b"JFIF\0") + 5] = 3
    return content


@pytest.mark.parametrize(
    ("damaged", "message"),
    [
        (with_an_unknown_transform_of_colours, "Unknown Adobe color transform code 9"),
        (with_a_repeated_scan, "Inconsistent progression sequence"),
        (with_an_unknown_revision_of_jfif, "Warning: unknown JFIF revision number 3.01"),
    ],
    ids=lambda value: getattr(value, "__name__", None),
)
def test_every_first_warning_of_libjpeg_is_a_refusal_because_it_hides_those_after_it(
    tmp_path, damaged, message, capfd
):
    (tmp_path / "a.jpg").write_bytes(damaged())
    with pytest.raises(ImageError, match=rf"damaged pixels \({message}"):
        read_image(tmp_path / "a.jpg")
    assert capfd.readouterr() == ("", "")


@pytest.fixture
def writing_meanwhile(monkeypatch):
    """A function that makes each decoding write bytes to standard error, as another thread could do."""

    def write(line: bytes) -> None:
        def imdecode(*arguments, decoded=cv2.imdecode):
            os.write(2, line)
            return decoded(*arguments)

        monkeypatch.setattr(cv2, "imdecode", imdecode)

    return write


@pytest.mark.filterwarnings("ignore::dic.errors.ImageWarning")
def test_lines_of_other_threads_are_passed_on_and_damage_nothing(jpeg, writing_meanwhile, capfd):
    path, decoded = jpeg
    writing_meanwhile(b"Warning: the camera is hot\n")
    assert np.array_equal(read_image(path), decoded)
    assert capfd.readouterr() == ("", "Warning: the camera is hot\n")


@pytest.mark.filterwarnings("ignore::dic.errors.ImageWarning")
def test_a_jpeg_is_read_although_nobody_reads_standard_error(jpeg, writing_meanwhile):
    path, decoded = jpeg
    writing_meanwhile(b"a line\n")
    reader, writer = os.pipe()
    os.close(reader)
    before = os.dup(2)
    os.dup2(writer, 2)
    try:
        image = read_image(path)
    finally:
        os.dup2(before, 2)
        os.close(before)
        os.close(writer)
    assert np.array_equal(image, decoded)


def test_a_warning_is_given_once_for_a_series(tmp_path):
    for number in range(3):
        Image.fromarray(SMOOTH.astype(np.uint8)).save(tmp_path / f"{number}.jpg")
    with warnings.catch_warnings(record=True) as said, each_warning_once():
        warnings.simplefilter("always")
        for number in range(3):
            read_image(tmp_path / f"{number}.jpg")
    assert [str(each.message).partition(":")[0] for each in said] == [str(tmp_path / "0.jpg")]
    assert "said once for the series" in str(said[0].message)


@pytest.mark.parametrize("brightest", [100, 255, 4095, 65535])
@pytest.mark.parametrize("colour", [False, True])
def test_levels_of_pgm_and_ppm_are_read_as_stored(tmp_path, brightest, colour):
    levels = NOISE.integers(0, brightest + 1, (40, 50, 3 if colour else 1))
    header = f"P{6 if colour else 5}\n# a comment\n50 40\n{brightest}\n".encode()
    (tmp_path / "a.pgm").write_bytes(header + levels.astype(">u2" if brightest > 255 else "u1").tobytes())
    expected = levels @ [0.299, 0.587, 0.114] if colour else levels[..., 0]
    assert np.allclose(read_image(tmp_path / "a.pgm"), expected, rtol=0, atol=1e-2)


@pytest.mark.parametrize("brightest", [100, 255, 4095])
@pytest.mark.parametrize("kind", ["P2", "P3"])
def test_levels_of_a_pgm_or_ppm_of_text_are_read_as_stored(tmp_path, kind, brightest):
    levels = NOISE.integers(0, brightest + 1, (40, 50))
    stored = levels.ravel() if kind == "P2" else np.repeat(levels, 3)
    (tmp_path / "a.pgm").write_text(f"{kind} 50 40 {brightest}\n{' '.join(map(str, stored))}")
    assert np.allclose(read_image(tmp_path / "a.pgm"), levels, rtol=0, atol=1e-2)


@pytest.mark.parametrize(
    ("content", "got"),
    [
        (b"P5\n50 40\n255\n" + bytes(1999), "cut off"),
        (b"P2\n50 40\n255\n" + b"7 " * 900, "cut off"),
        (b"P5\n50", "without a header"),
        (b"P5 50 40 70000\n" + bytes(4000), "grey levels up to 70000"),
        (b"P5 99999999 99999999 255\n", "megapixels"),
    ],
)
def test_a_damaged_pgm_is_refused(tmp_path, content, got, capfd):
    (tmp_path / "a.pgm").write_bytes(content)
    with pytest.raises(ImageError, match=got):
        read_image(tmp_path / "a.pgm")
    assert capfd.readouterr() == ("", "")
