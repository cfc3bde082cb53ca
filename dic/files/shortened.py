"""The middle of long lists is left out of what commands print and reports show; other files have all."""

from collections.abc import Sequence, Set

MOST, ENDS = 60, 20
"""Of more entries than the first number, only the second number at each end is printed."""
_MOST_SENTENCES = 30


def shown(count: int) -> Set[int]:
    """Return the indices of the entries that are printed."""
    if count <= MOST:
        return set(range(count))
    return {*range(ENDS), *range(count - ENDS, count)}


def left_out_text(count: int, where: str) -> str:
    """Return the line in place of the entries that are not printed; `where` names what has all of them."""
    return f"  … {count - 2 * ENDS} more of {count}; {where} all …"


def some_sentences(sentences: Sequence[str], where: str, most: int = _MOST_SENTENCES) -> list[str]:
    """Return the first sentences, and one in place of the others."""
    more = len(sentences) - most
    if more <= 1:
        return list(sentences)
    return [*sentences[:most], f"… and {more} more such sentences; {where} all"]
