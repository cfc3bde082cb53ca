"""Find numbers that are missing among the names of a series, such as img4 between img3 and img5."""

import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path

_PARTS = re.compile(r"(\d+)")
_LEAST_SHARE = 0.5
"""Numbers count in steps if more than this share of their differences equals the step.

Times of day have various differences, so they do not count in steps.
"""


def missing_numbers(files: Iterable[Path]) -> list[str]:
    """Return the names that are missing in the numbering of files, in order.

    A gap of several names is returned as "first to last". If names hold several numbers, the number with the
    most different values is the number of the image. If files also differ in another part of their names,
    such as the name of a camera, each group of files has its own numbering. Numbers may count in steps, such
    as 0, 10, 20. Numbers that do not count in steps, such as times of day, have no gaps.
    """
    parts = [_PARTS.split(path.name) for path in files]
    # If names differ only in their numbers, the texts between the numbers are equal. So the numbers are at
    # the same places.
    alike: dict[tuple[str, ...], list[list[str]]] = defaultdict(list)
    for each in parts:
        alike[tuple(each[::2])].append(each)
    found = []
    for names in alike.values():
        places = range(1, len(names[0]), 2)
        if places:
            # If the numbers at two places vary equally, take the later place, because a counter follows a
            # date.
            counting = max(places, key=lambda place: (len({name[place] for name in names}), place))
            found += _missing_at(names, counting)
    return found


def _missing_at(names: Sequence[list[str]], place: int) -> list[str]:
    groups: dict[tuple[str, ...], list[str]] = defaultdict(list)
    for name in names:
        groups[(*name[:place], "", *name[place + 1 :])].append(name[place])
    found = []
    for others, texts in groups.items():
        digits = min(map(len, texts))
        for first, last in _gaps(sorted(set(map(int, texts)))):
            ends = dict.fromkeys(
                "".join((*others[:place], f"{number:0{digits}d}", *others[place + 1 :]))
                for number in (first, last)
            )
            found.append(" to ".join(ends))
    return found


def _gaps(numbers: Sequence[int]) -> list[tuple[int, int]]:
    """Return the first and the last missing number of each gap."""
    differences = Counter(after - before for before, after in pairwise(numbers))
    if not differences:
        return []
    step, times = max(differences.items(), key=lambda item: (item[1], -item[0]))
    regular = all(difference % step == 0 for difference in differences)
    if not regular or times <= _LEAST_SHARE * differences.total():
        return []
    return [(a + step, b - step) for a, b in pairwise(numbers) if b - a > step]
