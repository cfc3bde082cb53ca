"""Options that are derived from settings, and the help that lists the most needed ones."""

import re

import pytest

import dic
from dic.commands.correlate import correlate
from dic.commands.process import process
from dic.commands.settings_file import SETTINGS
from dic.settings import declared_in, default_of
from tests.command_line import run_dic


@pytest.mark.parametrize("command", ["correlate", "process", "strain"])
def test_help_lists_at_most_ten_options_and_help_all_lists_all(command):
    few, every = (run_dic(command, word).out for word in ("--help", "--help-all"))
    listed = re.findall(r"^  (?:-\w, )?(--[\w-]+)", few, flags=re.MULTILINE)
    assert 3 <= len(set(listed) - {"--help", "--help-all"}) <= 10
    options = {"correlate": correlate, "process": process}.get(command)
    for parameter in () if options is None else options.params:
        if parameter.opts[-1].startswith("--"):
            assert parameter.opts[-1] in every


def test_each_setting_of_the_file_is_an_option_with_its_sentence_and_default():
    for setting in SETTINGS:
        own = [
            parameter
            for command in (correlate, process)
            for parameter in command.params
            if parameter.name is not None and parameter.name.endswith(f"_{setting.name}")
        ]
        assert own, setting
        assert own[0].help == setting.declared.sentence
        default = default_of(setting.kind, setting.name)
        if default is not None:
            assert own[0].default == setting.declared.text(default)


def test_documentation_of_settings_names_each_with_its_sentence_and_bounds():
    for kind in (dic.CorrelationSettings, dic.StrainSettings, dic.Motion, dic.pictures.MapSettings):
        for name, declared in declared_in(kind).items():
            assert f"{name} : " in kind.__doc__
            assert declared.sentence in kind.__doc__
            assert f"Possible: {declared.expected}." in kind.__doc__
