"""The command `dic`. Each subcommand is loaded only when it is called, so that `dic --help` starts fast."""

import gc
import os
from importlib import import_module

import click

_COMMANDS = {
    "assess": "dic.commands.assess:assess",
    "calibrate": "dic.commands.calibrate:calibrate",
    "campaign": "dic.commands.campaign:campaign",
    "channels": "dic.commands.channels:channels",
    "compare": "dic.commands.compare:compare",
    "correlate": "dic.commands.correlate:correlate",
    "draw": "dic.commands.draw:draw",
    "example": "dic.commands.example:example",
    "export": "dic.commands.export:export",
    "gauges": "dic.commands.gauges:gauges",
    "plot": "dic.commands.plot:plot",
    "process": "dic.commands.process:process",
    "properties": "dic.commands.properties:properties",
    "quality": "dic.commands.quality:quality",
    "report": "dic.commands.report:report",
    "settings": "dic.commands.settings:settings",
    "strain": "dic.commands.strain:strain",
    "study": "dic.commands.study:study",
    "target": "dic.commands.target:target",
}


class _LazyGroup(click.Group):
    """A command group of click that imports a subcommand's module when the subcommand is called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return sorted(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in _COMMANDS:
            return None
        module, attribute = _COMMANDS[cmd_name].split(":")
        # What modules create stays until the end. Searching it for garbage again and again takes a tenth of a
        # second.
        gc.disable()
        command: click.Command = getattr(import_module(module), attribute)
        gc.freeze()
        gc.enable()
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        try:
            return super().resolve_command(ctx, args)
        except click.exceptions.NoSuchCommand as error:
            # click itself suggests only commands that are loaded
            names = self.list_commands(ctx)
            raise click.exceptions.NoSuchCommand(error.command_name, possibilities=names, ctx=ctx) from None


@click.group(cls=_LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="offaxis")
def dic() -> None:
    """Off-axis two-dimensional digital image correlation: calibrate, correlate, report.

    Exit status: 0 for a good measurement, 1 for a measurement of poor quality, 2 for a failed measurement.
    """


def main() -> None:
    """Run the command `dic`; a `MeasurementError` is printed as one sentence and gives exit status 2."""
    from dic.errors import MeasurementError
    from dic.shell.console import run

    # Looking for plugins, of which `dic` needs none, pydantic reads the data of every installed package.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    run(dic, (MeasurementError,), "error")
