"""The positions, in bytes, of a camera's images in a run file."""

from typing import Any


def pixel_places(data: Any) -> dict[int, tuple[int, int]]:
    """Return the first byte and the number of bytes of each stored image, keyed by the row of the image.

    `data`: the dataset with the images of a camera. Each image is one chunk of the dataset.
    """
    places: dict[int, tuple[int, int]] = {}

    def note(chunk: Any) -> None:
        places[int(chunk.chunk_offset[0])] = int(chunk.byte_offset), int(chunk.size)

    data.id.chunk_iter(note)
    return places
