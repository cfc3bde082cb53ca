"""Write statements of RDF in the Turtle format (RDF 1.1 Turtle, W3C Recommendation of 2014)."""

import re
from collections.abc import Mapping
from urllib.parse import quote

_ESCAPES = {"\\": "\\\\", '"': '\\"', "\n": "\\n", "\r": "\\r", "\t": "\\t"}
_SEVERAL = " ,\n        "
_NOT_LOCAL = re.compile(r"^[-.]|\.$|~")


def quoted(text: str) -> str:
    """Return a text as a literal of the Turtle format."""
    escaped = "".join(_ESCAPES.get(sign, sign if sign >= " " else f"\\u{ord(sign):04X}") for sign in text)
    return f'"{escaped}"'


def number(value: float) -> str:
    """Return a finite number as a Turtle literal of the type xsd:double, with all its digits."""
    return f'"{float(value)!r}"^^xsd:double'


def local_name(text: str) -> str:
    """Return a text as the local part of a prefixed name; different texts have different names.

    Signs that an IRI or a prefixed name cannot contain are percent-encoded (RFC 3986).
    """
    return _NOT_LOCAL.sub(lambda found: f"%{ord(found[0]):02X}", quote(text, safe=""))


class Statements:
    """Statements about subjects, in the order in which the subjects were first named.

    `prefixes` has the beginning of the IRIs of each prefix. Subjects, predicates and objects are given as in
    Turtle, such as "obo:BFO_0000030".
    """

    def __init__(self, prefixes: Mapping[str, str]) -> None:
        self._prefixes = dict(prefixes)
        self._about: dict[str, dict[str, list[str]]] = {}

    def add(self, subject: str, predicate: str, *objects: str) -> None:
        """Add a statement for each object; a repeated statement has no effect."""
        known = self._about.setdefault(subject, {}).setdefault(predicate, [])
        known += [each for each in dict.fromkeys(objects) if each not in known]

    def text(self) -> str:
        """Return all statements as the text of a Turtle file."""
        heads = [f"@prefix {name}: <{iri}> ." for name, iri in self._prefixes.items()]
        blocks = []
        for subject, about in self._about.items():
            parts = [f"{name} {_SEVERAL.join(objects)}" for name, objects in about.items() if objects]
            blocks.append(f"{subject} " + " ;\n    ".join(parts) + " .")
        return "\n".join(heads) + "\n\n" + "\n\n".join(blocks) + "\n"
