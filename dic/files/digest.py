"""The SHA-256 of a file, by which results name the files that they come from."""

from errno import EFBIG
from hashlib import sha256
from math import inf
from pathlib import Path

from dic.files.reading import opened

_PIECE_BYTES = 1 << 20


def file_sha256(path: Path, most_bytes: float = inf) -> str:
    """Return the SHA-256 of a whole file, as the program `sha256sum` prints it.

    Raises
    ------
    OSError
        If the file cannot be read, or is larger than `most_bytes`.
    """
    digest = sha256()
    with opened(path) as content:
        if len(content) > most_bytes:
            raise OSError(EFBIG, "a file that is too large", str(path))
        for start in range(0, len(content), _PIECE_BYTES):
            digest.update(content[start : start + _PIECE_BYTES])
    return digest.hexdigest()
