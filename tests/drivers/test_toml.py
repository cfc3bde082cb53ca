"""Tests of reading and writing TOML files."""

import pytest

from drivers.errors import ConfigurationError
from drivers.settings import read_toml, toml_table


def test_a_table_is_written_as_it_is_read(tmp_path):
    table = {
        "text": 'quote " and \\ and größe 😀',
        "big key": 1,
        "numbers": [1, -2.5, 1e30, True],
        "within": {"a": {"b": [{"c": "x"}]}, "é": 2},
    }
    path = tmp_path / "written.toml"
    path.write_text(toml_table(["cameras", "größe"], table), encoding="utf-8")
    assert read_toml(path) == {"cameras": {"größe": table}}


def test_a_file_nested_beyond_all_use_is_refused(tmp_path):
    path = tmp_path / "deep.toml"
    path.write_text("a = " + "[" * 5000 + "]" * 5000)
    with pytest.raises(ConfigurationError, match="nested too deeply"):
        read_toml(path)
