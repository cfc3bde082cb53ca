from .digest import file_sha256 as file_sha256
from .lazy import Spool as Spool, by_index as by_index
from .reading import read_text as read_text
from .shortened import (
    left_out_text as left_out_text,
    shown as shown,
    some_sentences as some_sentences,
)
from .writing import write_text as write_text
