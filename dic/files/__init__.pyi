from .digest import file_sha256 as file_sha256
from .lazy import Spool as Spool, by_index as by_index
from .reading import read_text as read_text
from .writing import write_text as write_text
