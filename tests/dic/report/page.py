"""Write a report to a file, and parse its HTML strictly."""

from html.parser import HTMLParser
from pathlib import Path

import pytest

from dic.pipeline.result import RunResult
from dic.report import write_report

UNDRAWN = "data:image/png;base64,"
_VOID = {"meta", "img", "br", "link", "hr", "input"}


class Page(HTMLParser):
    """The content of an HTML page in which every tag is closed in order: attributes, texts and tables."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.attributes: list[tuple[str, str]] = []
        self.tables: dict[str, list[list[str]]] = {}
        self.captions: list[str] = []
        self.text = ""
        self._table = ""
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.attributes += [(name, value or "") for name, value in attrs]
        if tag in _VOID:
            return
        self.open.append(tag)
        if tag == "table":
            self._table = f"{dict(attrs).get('class', '')} {len(self.tables)}"
            self.tables[self._table] = []
        elif tag == "tr":
            self.tables[self._table].append([])
        elif tag in ("td", "th"):
            self.tables[self._table][-1].append("")
        elif tag == "figcaption":
            self.captions.append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "style" in self.open:
            return
        self.text += data
        if "figcaption" in self.open:
            self.captions[-1] += data
        if {"td", "th"} & set(self.open):
            self.tables[self._table][-1][-1] += data

    def values(self, name: str) -> list[str]:
        return [value for attribute, value in self.attributes if attribute == name]

    def all_tables(self, kind: str) -> list[list[list[str]]]:
        chosen = [t for n, t in self.tables.items() if n.rsplit(" ", 1)[0] == kind]
        return [[[" ".join(c.split()) for c in row] for row in t] for t in chosen]

    def table(self, kind: str) -> list[list[str]]:
        return self.all_tables(kind)[0]


def number(text: str) -> float:
    return float(text.replace("−", "-").replace("\u202f", ""))


def leave_undrawn(patch: pytest.MonkeyPatch) -> None:
    """Let an empty picture stand for every picture in PNG format of a run's report."""
    for name in ("field_pictures.pixels_uri", "calibration.png_uri", "setup_figures.png_uri"):
        patch.setattr(f"dic.report.{name}", lambda drawn, **how: UNDRAWN)


def written(tmp_path: Path, *results: RunResult, fields: bool = True, drawn: bool = True) -> str:
    """Return the HTML of a report.

    Without `fields`, the report has no pictures of strain fields. Unless the pictures are `drawn`, an empty
    one stands for every picture in PNG format. Drawing these pictures takes most of the time of a report.
    """
    path = tmp_path / "report.html"
    with pytest.MonkeyPatch.context() as patch:
        if not fields:
            patch.setattr("dic.report.page.field_pictures", lambda run, proof: [])
        if not drawn:
            leave_undrawn(patch)
        write_report(results, path)
    return path.read_text(encoding="utf-8")
