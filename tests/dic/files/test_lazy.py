"""Sequences whose elements are computed when they are used, or kept in a temporary file."""

import weakref
from operator import attrgetter

import pytest

from dic.files.lazy import Computed, Spool, by_index
from tests.full_disk import full_disk


class Element:
    """An object that notes how many others of its kind exist when it is made."""

    def __init__(self) -> None:
        self.others = len(ALIVE)
        ALIVE.add(self)


ALIVE: "weakref.WeakSet[Element]" = weakref.WeakSet()


def test_one_element_is_freed_before_the_next_is_computed():
    elements = Computed(4, lambda k: Element())
    assert [elements[k].others for k in range(4)] == [0] * 4
    assert list(map(attrgetter("others"), elements)) == [0] * 4


def test_elements_of_several_sequences_are_freed_before_the_next():
    elements, others = Computed(4, lambda k: Element()), []
    for name, element, number in by_index("abcd", elements, range(4)):
        assert name == "abcd"[number]
        others.append(element.others)
        del element
    assert others == [0] * 4
    with pytest.raises(ValueError, match="4, 4 and 3 elements"):
        next(by_index("abcd", elements, range(3)))


def test_the_last_element_is_computed_once():
    asked = []
    elements = Computed(3, lambda k: asked.append(k) or f"element {k}")
    assert [elements[1], elements[1], elements[-2]] == ["element 1"] * 3
    assert asked == [1]
    assert list(elements[1:]) == ["element 1", "element 2"]
    with pytest.raises(IndexError):
        elements[3]


def test_an_element_that_cannot_be_computed_leaves_the_others():
    elements = Computed(2, lambda k: 1 // k)
    assert elements[1] == 1
    with pytest.raises(ZeroDivisionError):
        elements[0]
    assert elements[1] == 1


def test_items_that_found_no_room_are_told_of_once():
    """Freeing the file writes what is left of them again; nobody could catch that second error."""
    items: Spool[bytes] = Spool()
    with full_disk(1000):
        items.put(0, bytes(900))
        items.put(1, bytes(900))
        with pytest.raises(OSError, match="too large"):
            items[1]
        del items
