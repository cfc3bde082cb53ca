"""The command `dic`: its subcommands are loaded when they are called, so that help comes at once."""

from importlib import import_module

import click

_COMMANDS = {
    "assess": "dic.commands.assess:assess",
    "calibrate": "dic.commands.calibrate:calibrate",
    "correlate": "dic.commands.correlate:correlate",
    "process": "dic.commands.process:process",
    "quality": "dic.commands.quality:quality",
    "report": "dic.commands.report:report",
}


class _LazyGroup(click.Group):
    """A group that knows its subcommands by module and attribute."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return sorted(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in _COMMANDS:
            return None
        module, attribute = _COMMANDS[cmd_name].split(":")
        command: click.Command = getattr(import_module(module), attribute)
        return command


@click.group(cls=_LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="offaxis")
def dic() -> None:
    """Off-axis two-dimensional digital image correlation: calibrate, correlate, report.

    Exits with 0, with 1 if the measurement was made but is not good, with 2 if it could not be made.
    """


def main() -> None:
    """Run the command; an error that was foreseen becomes one sentence and status 2."""
    from dic.errors import MeasurementError
    from dic.shell.console import run

    run(dic, (MeasurementError,), "error")
