"""The pages lead nowhere wrong, and show commands as they are."""

import click
import pytest

import dic.cli
import rig.cli
from tests.docs.pages import PAGES, commands, links, name

PROGRAMS = {"dic": dic.cli.dic, "rig": rig.cli.cli}


def refused(words: list[str]) -> str | None:
    """What the command says against its arguments; nothing is run."""
    program, command, *arguments = words
    group = PROGRAMS[program]
    context = click.Context(group, info_name=program)
    try:
        named, known, _ = group.resolve_command(context, [command])
        assert known is not None
        known.make_context(named, arguments, parent=context).close()
    except click.UsageError as error:
        return f"{' '.join(words)}: {error.format_message()}"
    return None


def is_synopsis(words: list[str]) -> bool:
    """Whether brackets or an ellipsis stand for what a reader may put there."""
    return any(mark in word for word in words for mark in "[…")


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_links_lead_to_files(page):
    assert [target for target in links(page) if not (page.parent / target).exists()] == []


@pytest.mark.parametrize("page", [page for page in PAGES if commands(page)], ids=name)
def test_commands_are_taken(page):
    shown = [words for words in commands(page) if not is_synopsis(words)]
    assert [complaint for complaint in map(refused, shown) if complaint] == []


def test_a_wrong_command_would_be_noticed():
    assert "No such command" in (refused(["dic", "calibrat", "grid.png"]) or "")
    assert "No such option" in (refused(["rig", "plan", "a.toml", "--rigs", "b.toml"]) or "")
