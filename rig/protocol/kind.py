"""The key `kind`, which names the form of a protocol file."""

from typing import Annotated, TypeAlias, TypeVar

from pydantic import BeforeValidator

KINDS = ("tension", "rotation", "phases")

T = TypeVar("T")


def _known_kind(kind: object) -> object:
    # Check the kind here, so that the error message names all valid kinds and not only one.
    if kind not in KINDS:
        *others, last = (f"'{known}'" for known in KINDS)
        raise ValueError(f"{', '.join(others)} or {last} is expected")
    return kind


KnownKind: TypeAlias = Annotated[T, BeforeValidator(_known_kind)]
