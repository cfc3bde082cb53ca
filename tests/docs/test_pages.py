"""All links, names and commands in the documentation pages exist."""

from pkgutil import resolve_name

import click
import pytest

import dic.cli
import rig.cli
from tests.docs.pages import PAGES, commands, dotted_names, links, name, paths
from tests.places import ROOT

PROGRAMS = {"dic": dic.cli.dic, "rig": rig.cli.cli}


def refused(words: list[str]) -> str | None:
    """Return the error message of a command about its arguments, or None; the command is not executed."""
    return _refused(PROGRAMS[words[0]], words)


def _refused(group: click.Group, words: list[str]) -> str | None:
    program, command, *arguments = words
    context = click.Context(group, info_name=program)
    try:
        named, known, _ = group.resolve_command(context, [command])
        assert known is not None
        if isinstance(known, click.Group):
            # such as `dic plot cuts`
            return _refused(known, [f"{program} {command}", *arguments])
        known.make_context(named, arguments, parent=context).close()
    except click.UsageError as error:
        return f"{' '.join(words)}: {error.format_message()}"
    return None


def is_synopsis(words: list[str]) -> bool:
    """Return True if a command contains brackets or an ellipsis as placeholders."""
    return any(mark in word for word in words for mark in "[…")


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_links_lead_to_files(page):
    assert [target for target in links(page) if not (page.parent / target).exists()] == []


@pytest.mark.parametrize("page", [page for page in PAGES if page.name != "CHANGELOG.md"], ids=name)
def test_files_and_names_exist(page):
    """What the page names in backquotes can be opened, or imported; only the changelog names what is gone."""
    assert [path for path in paths(page) if not any(ROOT.glob(path.rstrip("/")))] == []
    assert [dotted for dotted in dotted_names(page) if not can_be_imported(dotted)] == []


def can_be_imported(dotted: str) -> bool:
    """Return True if the dotted name is a module, or an attribute of a module or class."""
    try:
        resolve_name(dotted)
    except (ImportError, AttributeError):
        return False
    return True


@pytest.mark.parametrize("page", [page for page in PAGES if commands(page)], ids=name)
def test_commands_are_taken(page):
    shown = [words for words in commands(page) if not is_synopsis(words)]
    assert [complaint for complaint in map(refused, shown) if complaint] == []


def test_a_wrong_name_would_be_noticed():
    assert can_be_imported("dic.Calibration.fit")
    assert not can_be_imported("dic.Calibration.load")
    assert not can_be_imported("drivers.frame_stream")


def test_a_wrong_command_would_be_noticed():
    assert "No such command" in (refused(["dic", "calibrat", "grid.png"]) or "")
    assert "No such option" in (refused(["rig", "plan", "a.toml", "--rigs", "b.toml"]) or "")
    assert "No such option" in (refused(["dic", "plot", "cuts", "r.h5", "--rigs", "b.toml"]) or "")
    assert "No such command" in (refused(["dic", "plot", "cut", "r.h5"]) or "")
