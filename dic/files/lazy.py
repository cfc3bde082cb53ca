"""Sequences whose elements are not kept in memory: they are computed, or read from a temporary file."""

import pickle
import tempfile
import weakref
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any, BinaryIO, Generic, TypeVar, overload

Key = TypeVar("Key")
Item = TypeVar("Item")
Other = TypeVar("Other")
Third = TypeVar("Third")


class Computed(Sequence[Item]):
    """A sequence whose elements a function returns when they are used; only the last result stays in memory.

    `count`: number of elements. `element`: function that returns the element with the given index, from 0.
    """

    def __init__(self, count: int, element: Callable[[int], Item]) -> None:
        self._count, self._element = count, element
        self._last: tuple[int, Item] | None = None

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, index: int) -> Item: ...
    @overload
    def __getitem__(self, index: slice) -> "Computed[Item]": ...
    def __getitem__(self, index: int | slice) -> "Item | Computed[Item]":
        chosen = range(self._count)[index]
        if isinstance(chosen, range):
            return Computed(len(chosen), lambda k: self[chosen[k]])
        last = self._last
        if last is None or last[0] != chosen:
            # Free the memory of one element before the next one needs it.
            last = self._last = None
            last = self._last = chosen, self._element(chosen)
        return last[1]

    def __iter__(self) -> Iterator[Item]:
        # The iterator of `Sequence` keeps an element until it has the next one.
        for k in range(self._count):
            yield self[k]


def by_index(
    firsts: Sequence[Item], others: Sequence[Other], thirds: Sequence[Third]
) -> Iterator[tuple[Item, Other, Third]]:
    """Yield the elements with the same index, as `zip` does, but keep none of them.

    `zip` keeps the elements that it has yielded until it has the next ones. So two elements of a `Computed`
    would be in memory. To free the last element, the caller must delete its variables, too.
    """
    if not len(firsts) == len(others) == len(thirds):
        raise ValueError(f"{len(firsts)}, {len(others)} and {len(thirds)} elements")
    for k in range(len(firsts)):
        yield firsts[k], others[k], thirds[k]


class ComputedMapping(Mapping[Key, Item]):
    """A mapping whose values are the elements of a sequence, which may be computed."""

    def __init__(self, keys: Iterable[Key], values: Sequence[Item]) -> None:
        self._places = {key: place for place, key in enumerate(keys)}
        self._values = values

    def __len__(self) -> int:
        return len(self._places)

    def __iter__(self) -> Iterator[Key]:
        return iter(self._places)

    def __getitem__(self, key: Key) -> Item:
        return self._values[self._places[key]]


class Spool(Generic[Item]):
    """Numbered items in a temporary file. Memory does not grow with the size of the items.

    The file has no name, and disappears with the object.
    """

    def __init__(self) -> None:
        self._file: Any = tempfile.TemporaryFile()  # noqa: SIM115
        self._places: dict[int, int] = {}
        weakref.finalize(self, _close, self._file)

    def __len__(self) -> int:
        return len(self._places)

    def __getitem__(self, number: int) -> Item:
        self._file.seek(self._places[number])
        found: Item = pickle.load(self._file)  # safe: no other program can write to the file
        return found

    def __iter__(self) -> Iterator[Item]:
        """Yield the items in the order of their numbers."""
        return (self[number] for number in sorted(self._places))

    def put(self, number: int, item: Item) -> None:
        """Write an item. An earlier item with the same number is replaced."""
        self._places[number] = self._file.seek(0, 2)
        pickle.dump(item, self._file)


def _close(file: BinaryIO) -> None:
    # On a full disk, closing fails as writing did before, and Python would print a second error at the end.
    with suppress(OSError):
        file.close()
