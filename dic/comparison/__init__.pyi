from .difference import (
    Comparison as Comparison,
    Difference as Difference,
)
from .peer import PeerField as PeerField
from .read import read_peer as read_peer
