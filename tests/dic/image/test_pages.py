"""Tests of pages of TIFF files, folders and patterns, with images that Pillow and OpenCV have written."""

import os
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image

from dic.errors import ImageError, ImageWarning
from dic.image import tiff
from dic.image.pages import in_natural_order, list_images, natural_key
from dic.image.read import read_image
from dic.image.tiff import page_directories
from tests.image_files import write_image


def pictures(number: int, depth: type = np.uint8) -> list[np.ndarray]:
    noise = np.random.default_rng(3)
    return [noise.integers(0, np.iinfo(depth).max, (48, 64)).astype(depth) for _ in range(number)]


def stack_by_pillow(path: Path, images: list[np.ndarray]) -> None:
    first, *others = map(Image.fromarray, images)
    first.save(path, save_all=True, append_images=others)


def big_tiff_by_pillow(path: Path, images: list[np.ndarray]) -> None:
    first, *others = map(Image.fromarray, images)
    first.save(path, save_all=True, append_images=others, big_tiff=True)
    assert path.read_bytes()[2] == 43


def stack_by_opencv(path: Path, images: list[np.ndarray]) -> None:
    assert cv2.imwritemulti(str(path), images)


def big_endian_stack(path: Path, images: list[np.ndarray], tags: tuple[tuple[int, int], ...] = ()) -> None:
    """Write a big-endian TIFF without a library, with the directory of each page behind the page's pixels."""
    file, link = bytearray(b"MM\0*\0\0\0\0"), 4
    for image in images:
        at = len(file)
        file += image.astype(">u2").tobytes()
        height, width = image.shape
        entries = [(256, width), (257, height), (258, 16), (259, 1), (262, 1), (273, at), (277, 1)]
        entries += [(278, height), (279, 2 * image.size), *tags]
        struct.pack_into(">I", file, link, len(file))
        file += struct.pack(">H", len(entries))
        file += b"".join(struct.pack(">HHII", tag, 4, 1, value) for tag, value in sorted(entries))
        link = len(file)
        file += bytes(4)
    path.write_bytes(file)


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
@pytest.mark.parametrize("write", [stack_by_pillow, big_tiff_by_pillow, stack_by_opencv, big_endian_stack])
def test_every_page_of_a_stack_is_read_as_stored(tmp_path, write, depth):
    images = pictures(4, depth)
    write(tmp_path / "stack.tif", images)
    listed = list_images(tmp_path / "stack.tif")
    assert [path.name for path in listed] == [f"stack.tif#{page}" for page in (1, 2, 3, 4)]
    for path, image in zip(listed, images, strict=True):
        assert np.array_equal(read_image(path), image)


def test_chain_of_pages_is_followed_once_for_a_stack_and_anew_for_a_changed_one(tmp_path, monkeypatch):
    followed = []

    def follow(content):
        followed.append(content)
        return page_directories(content)

    monkeypatch.setattr(tiff, "page_directories", follow)
    for number in (5, 3):
        images = pictures(number)
        stack_by_pillow(tmp_path / "stack.tif", images)
        for path, image in zip(list_images(tmp_path / "stack.tif"), images, strict=True):
            assert np.array_equal(read_image(path), image)
    assert len(followed) == 2


def test_stack_in_the_place_of_one_image_is_said_aloud(tmp_path):
    stack_by_pillow(tmp_path / "stack.tif", pictures(3))
    with pytest.warns(ImageWarning, match=r"holds 3 pages, and only the first one is read.*stack\.tif#3"):
        first = read_image(tmp_path / "stack.tif")
    assert np.array_equal(first, pictures(3)[0])


def test_page_that_is_not_there_is_refused(tmp_path):
    stack_by_pillow(tmp_path / "stack.tif", pictures(3))
    with pytest.raises(ImageError, match=r"stack\.tif#4: .*got a TIFF with 3 pages; name a page from 1 to 3"):
        read_image(tmp_path / "stack.tif#4")
    write_image(tmp_path / "one.png", pictures(1)[0])
    with pytest.raises(ImageError, match="got a file with one page"):
        read_image(tmp_path / "one.png#2")


def test_file_whose_own_name_looks_like_a_page_is_read_itself(tmp_path):
    write_image(tmp_path / "a.png", pictures(1)[0])
    (tmp_path / "a.png").rename(tmp_path / "a.png#2")
    assert np.array_equal(read_image(tmp_path / "a.png#2"), pictures(1)[0])


def test_smaller_copies_and_masks_are_no_pages(tmp_path):
    """The tag 254, NewSubfileType: bit 0 is a smaller copy, bit 2 a mask (TIFF 6.0, section 8)."""
    for kind, pages in ((0, 3), (1, 1), (4, 1), (2, 3)):
        big_endian_stack(tmp_path / "a.tif", pictures(2, np.uint16), ((254, kind),))
        content = bytearray((tmp_path / "a.tif").read_bytes())
        big_endian_stack(tmp_path / "b.tif", pictures(1, np.uint16))
        whole = (tmp_path / "b.tif").read_bytes()
        # b.tif with both pages of a.tif behind its own: places in a.tif count from the end of b.tif
        shifted = _shifted(content, len(whole))
        joined = bytearray(whole) + shifted
        struct.pack_into(">I", joined, len(whole) - 4, struct.unpack_from(">I", shifted, 4)[0])
        (tmp_path / "joined.tif").write_bytes(joined)
        assert len(list_images(tmp_path / "joined.tif")) == pages


def test_stack_whose_pages_all_claim_to_be_smaller_copies_keeps_its_pages(tmp_path):
    big_endian_stack(tmp_path / "a.tif", pictures(3, np.uint16), ((254, 1),))
    assert len(list_images(tmp_path / "a.tif")) == 3


def test_strips_that_share_their_bytes_are_refused_before_they_are_copied(tmp_path):
    """Such a file of 1 MB could ask for gigabytes."""
    image, strips = pictures(1)[0], 12
    path = tmp_path / "a.tif"
    Image.fromarray(image).save(path, tiffinfo={278: image.shape[0] // strips})
    content = bytearray(path.read_bytes())
    assert np.array_equal(read_image(path), image)
    with tifffile.TiffFile(path) as file:
        starts, sizes = (file.pages.first.tags[tag] for tag in (273, 279))
    for tag, value in ((starts, 8), (sizes, image.size)):
        struct.pack_into(f"<{tag.count}I", content, tag.valueoffset, *[value] * tag.count)
    path.write_bytes(content)
    with pytest.raises(ImageError, match=rf"a TIFF whose strips overlap: {strips * image.size} bytes in a"):
        read_image(path)


def test_tags_that_share_their_bytes_are_refused_before_they_are_copied(tmp_path):
    tags, size = 40, 1000
    directory = b"".join(struct.pack("<HHII", 40_000 + tag, 1, size, 8) for tag in range(tags))
    head = struct.pack("<2sHI", b"II", 42, 8 + size) + bytes(size)
    (tmp_path / "a.tif").write_bytes(head + struct.pack("<H", tags) + directory + bytes(4))
    assert list_images(tmp_path / "a.tif") == [tmp_path / "a.tif"]
    with pytest.raises(ImageError, match="got a TIFF whose tags overlap"):
        read_image(tmp_path / "a.tif")


def circle_of_directories(tmp_path, number=200):
    """Write directories of one tag each; the last one is followed by the first one."""
    at = [8 + 18 * place for place in range(number)]
    directories = (struct.pack("<HHHIII", 1, 256, 4, 1, 64, following) for following in [*at[1:], at[0]])
    (tmp_path / "a.tif").write_bytes(struct.pack("<2sHI", b"II", 42, 8) + b"".join(directories))
    return "got a TIFF without pixels"


def tags_that_share_their_megabyte(tmp_path, tag=273, number=4000):
    """Write tags of the places of strips, all of which have the same million of zeros."""
    entries = struct.pack("<HHII", tag, 4, 250_000, 8) * number
    head = struct.pack("<2sHI", b"II", 42, 8 + 10**6) + bytes(10**6)
    (tmp_path / "a.tif").write_bytes(head + struct.pack("<H", number) + entries + bytes(4))
    return "got a TIFF whose tags overlap"


@pytest.mark.parametrize("write", [circle_of_directories, tags_that_share_their_megabyte])
@pytest.mark.timeout(60)
def test_small_file_takes_neither_all_time_nor_all_memory_of_tifffile(tmp_path, write):
    said = write(tmp_path)
    with pytest.raises(ImageError, match=said):
        read_image(tmp_path / "a.tif")


def test_separate_planes_of_16_bit_are_refused_because_opencv_fills_them_with_noise(tmp_path):
    planes = np.stack(pictures(3, np.uint16))
    tifffile.imwrite(tmp_path / "a.tif", planes, photometric="rgb", planarconfig="separate")
    with pytest.raises(ImageError, match="separate planes for the colours; save it with the colours of a"):
        read_image(tmp_path / "a.tif")
    tifffile.imwrite(
        tmp_path / "a.tif", (planes >> 8).astype("u1"), photometric="rgb", planarconfig="separate"
    )
    luma = np.tensordot([0.299, 0.587, 0.114], planes >> 8, 1)
    assert np.allclose(read_image(tmp_path / "a.tif"), luma, rtol=0, atol=1e-3)


def test_name_of_a_page_that_is_too_long_is_refused_like_any_file(tmp_path):
    with pytest.raises(ImageError, match="got File name too long; name an image file that exists"):
        read_image(tmp_path / f"{'x' * 300}#1")


def _shifted(content: bytearray, by: int) -> bytearray:
    """Return the content of a `big_endian_stack` with `by` added to all its offsets."""
    link = 4
    while at := struct.unpack_from(">I", content, link)[0]:
        struct.pack_into(">I", content, link, at + by)
        (entries,) = struct.unpack_from(">H", content, at)
        for place in range(at + 2, at + 2 + 12 * entries, 12):
            tag, _, _, value = struct.unpack_from(">HHII", content, place)
            if tag == 273:
                struct.pack_into(">I", content, place + 8, value + by)
        link = at + 2 + 12 * entries
    return content


def test_tags_that_the_decoder_does_not_know_are_read_in_silence(tmp_path, capfd):
    image = pictures(1, np.uint16)
    big_endian_stack(tmp_path / "a.tif", image, ((65000, 7), (50838, 9)))
    assert np.array_equal(read_image(tmp_path / "a.tif"), image[0])
    assert capfd.readouterr() == ("", "")


def test_large_stack_of_imagej_is_refused_because_its_pages_have_no_directories(tmp_path):
    described = {270: "ImageJ=1.53t\nimages=500\nslices=500\n"}
    Image.fromarray(pictures(1)[0]).save(tmp_path / "a.tif", tiffinfo=described)
    with pytest.raises(ImageError, match="a stack of ImageJ with 500 images and directories for 1"):
        read_image(tmp_path / "a.tif")


OME = (
    '<?xml version="1.0"?><OME><Image>'
    '<Pixels DimensionOrder="{}" SizeX="64" SizeC="2" SizeZ="1" SizeT="3"/></Image></OME>'
)


@pytest.mark.parametrize(
    ("description", "channel_1"),
    [
        ("ImageJ=1.54\nimages=6\nchannels=2\nframes=3\nhyperstack=true\n", "a.tif#1 a.tif#3 a.tif#5"),
        (OME.format("XYCZT"), "a.tif#1 a.tif#3 a.tif#5"),
        (OME.format("XYZTC"), "a.tif#1 a.tif#2 a.tif#3"),
        ("ImageJ=1.54\nimages=6\nslices=2\nframes=3\nhyperstack=true\n", "a.tif#1 a.tif#3 a.tif#5"),
        (OME.format("XYZTC").replace('C="2"', 'C="1"').replace('Z="1"', 'Z="2"'), "a.tif#1 a.tif#3 a.tif#5"),
        ('{"shape": [3, 2, 64, 64], "axes": "TCYX"}', "a.tif#1 a.tif#3 a.tif#5"),
        ('{"shape": [2, 3, 64, 64], "axes": "CTYX"}', "a.tif#1 a.tif#2 a.tif#3"),
        ('{"shape": [6, 64, 64], "axes": "TYX"}', None),
        ('{"shape": [6, 64, 64]}', None),
        ("ImageJ=1.54\nimages=6\nslices=6\n", None),
        ("ImageJ=1.54\nimages=6\nframes=6\n", None),
        ("ImageJ=1.54\nimages=6\nchannels=4\n", None),
        (OME.format("XYCZT").replace('SizeC="2"', 'SizeC="1"'), None),
        ("6 images in 2 channels=2", None),
    ],
)
def test_channels_and_depths_of_a_stack_are_no_series_of_images(
    tmp_path, monkeypatch, description, channel_1
):
    monkeypatch.chdir(tmp_path)
    images = [picture.astype(np.uint8) for picture in pictures(6)]
    with tifffile.TiffWriter("a.tif") as file:
        for number, image in enumerate(images):
            file.write(image, description=description if number == 0 else None, metadata=None)
    if channel_1 is None:
        assert len(list_images("a.tif")) == 6
        return
    with pytest.raises(ImageError, match=f"2 series of 3 images each; .* of the first being {channel_1}$"):
        list_images("a.tif")
    assert names(list_images(*channel_1.split())) == channel_1.split()


def test_names_with_numbers_are_in_the_order_of_the_numbers():
    names = ["img10.png", "img2.png", "IMG1.png", "a3b12", "a3b2", "a", "7", "img2.bmp"]
    assert sorted(names, key=natural_key) == [
        "7", "a", "a3b2", "a3b12", "IMG1.png", "img2.bmp", "img2.png", "img10.png"
    ]  # fmt: skip


@pytest.mark.parametrize(
    "names",
    [
        ["c_-0002.png", "c_-0001.png", "c_0000.png", "c_0001.png"],
        ["c_-12", "c_-2", "c_-1"],
        ["frame-10.tif", "frame-2.tif", "frame0.tif", "frame3.tif"],
        ["t=\u22122.5", "t=\u22121.5", "t=0.5"],
        ["a (-3) b", "a (-1) b", "a (2) b"],
        # decimals
        ["t_-0.5s.png", "t_0.0s.png", "t_0.5s.png", "t_1.0s.png"],
        ["l_0.png", "l_0.5.png", "l_1.png", "l_1.25.png"],
        ["F_1kN.tif", "F_1,5kN.tif", "F_10kN.tif"],
        # points that separate
        ["cam1.8.tif", "cam1.9.tif", "cam1.10.tif"],
        ["a.1.9.tif", "a.1.10.tif"],
        ["cam1.1.tif", "cam1.2.tif", "cam1.11.tif"],
        # a hyphen that only separates
        ["img-1", "img-2", "img-10"],
        ["scan -1", "scan -2"],
        ["2026-01-05_1", "2026-01-05_2", "2026-02-01_1"],
        ["10-1", "10-2", "10-12"],
        ["Cam-1_-1", "Cam-1_0", "Cam-2_-1", "Cam-2_0"],
    ],
)
def test_numbers_below_zero_come_first_and_a_hyphen_that_separates_is_no_sign(names):
    paths = [Path(name) for name in names]
    assert in_natural_order(reversed(paths)) == paths
    assert in_natural_order(sorted(paths)) == paths


def test_names_listed_by_a_shell_that_ignores_signs_are_put_in_natural_order(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    listed = ["c_0000.png", "c_-0001.png", "c_0001.png", "c_-0002.png"]
    assert names(list_images(*listed)) == ["c_-0002.png", "c_-0001.png", "c_0000.png", "c_0001.png"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    for name in ("img10.png", "img2.PNG", "img1.png", "mask.tif", ".hidden.png"):
        (tmp_path / name).write_bytes(b"")
    (tmp_path / "notes.txt").write_text("no image")
    (tmp_path / "deeper.png").mkdir()
    monkeypatch.chdir(tmp_path)
    return tmp_path


def names(images: list[Path]) -> list[str]:
    return [path.name for path in images]


def test_folder_means_its_images_in_natural_order(folder):
    assert names(list_images(folder)) == ["img1.png", "img2.PNG", "img10.png", "mask.tif"]


@pytest.mark.parametrize("absolute", [False, True])
def test_pattern_means_the_files_that_match(folder, absolute):
    pattern = f"{folder}/img*" if absolute else "img*"
    assert names(list_images(pattern)) == ["img1.png", "img2.PNG", "img10.png"]


def test_names_as_a_shell_lists_them_are_put_in_natural_order_and_others_are_kept(folder):
    assert names(list_images("img1.png", "img10.png", "img2.PNG")) == ["img1.png", "img2.PNG", "img10.png"]
    assert names(list_images("img2.PNG", "img1.png", "img10.png")) == ["img2.PNG", "img1.png", "img10.png"]


@pytest.mark.parametrize(
    ("source", "got"),
    [("x*.png", "expected a pattern that files match, got none"), ("deeper.png", "a folder with images")],
)
def test_place_without_images_is_refused(folder, source, got):
    with pytest.raises(ImageError, match=got):
        list_images(source)


def test_file_whose_name_looks_like_a_pattern_is_itself(folder):
    (folder / "a[1].png").write_bytes(b"")
    assert names(list_images("a[1].png")) == ["a[1].png"]


@pytest.mark.parametrize(
    ("name", "got"), [("a\0b.png", "a name with a NUL character"), ("x" * 300 + ".png", "File name too long")]
)
def test_a_name_that_no_file_can_have_is_refused_by_the_reader(tmp_path: Path, name: str, got: str) -> None:
    assert list_images(tmp_path / name) == [tmp_path / name]
    with pytest.raises(ImageError, match=f"{got}; name an image file that exists"):
        read_image(tmp_path / name)


@pytest.mark.parametrize("content", [b"II*\0" + bytes(12), b"II*\0\0\0\0\0" + bytes(4000)])
def test_file_that_was_not_written_to_its_end_is_told_by_its_reader(tmp_path, content):
    (tmp_path / "a.tif").write_bytes(content)
    assert list_images(tmp_path / "a.tif") == [tmp_path / "a.tif"]
    with pytest.raises(ImageError, match="a TIFF without pages, which was not written to its end"):
        read_image(tmp_path / "a.tif")


def test_name_that_is_no_utf_8_is_refused_in_one_sentence(tmp_path):
    name = os.fsdecode(b"pr\xfcfung.png")
    (tmp_path / name).write_bytes(b"")
    with pytest.raises(ImageError, match=r"pr\\udcfcfung.png: list images: expected a name in UTF-8"):
        list_images(tmp_path)
