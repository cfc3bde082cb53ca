"""Make bad values for all numeric options of every command."""

from collections.abc import Iterator

import click

import dic.cli
import rig.cli

_NUMBERS = ("nan", "inf", "-inf", "1e999", "", "x", "9" * 5000, "1,5", "0x10", "٣x")
_WHOLE = ("1.5", "nan", "", "x", "1e3", "-1000000000000000000000000000000")


def bad_options(program: str, command: str) -> Iterator[list[str]]:
    """Yield options of a command with values that are not valid numbers."""
    group = {"dic": dic.cli.dic, "rig": rig.cli.cli}[program]
    assert isinstance(group, click.Group)
    parameters = group.get_command(click.Context(group), command)
    assert parameters is not None
    for option in parameters.params:
        if not isinstance(option, click.Option):
            continue
        # FloatRange and IntRange are both FloatParamType and IntParamType
        kinds = {click.types.FloatParamType: _NUMBERS, click.types.IntParamType: _WHOLE}
        bad = next((values for kind, values in kinds.items() if isinstance(option.type, kind)), ())
        if isinstance(option.type, click.Tuple):
            bad = _NUMBERS
        for value in bad:
            yield [f"{option.opts[-1]}", *([value] * option.nargs)]
