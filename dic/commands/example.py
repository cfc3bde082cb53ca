"""The command `dic example`, which writes a small measurement with which to try the other commands."""

import shlex
from pathlib import Path

import click

import dic
from dic.errors import OutputError
from dic.shell.console import say
from dic.shell.output_paths import FORCE, PATH, require_places

NEXT = (
    "dic quality {0}/reference.png",
    "dic calibrate {0}/grid.png --lines 21x21 --pitch-mm 0.5 -o cal.h5",
    "dic correlate {0}/reference.png {0}/step-*.png --calibration cal.h5 --roi {0}/mask.png --motion tension"
    " --maps maps",
)


@click.command()
@click.argument("folder", type=PATH)
@FORCE
def example(folder: Path, force: bool) -> None:
    """Write a small tension test to FOLDER: images, a mask, the machine's record, and the true strains.

    The images are simulated, so the strain in each of them is known exactly. The command prints further
    commands, which measure these images.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        require_places([], dic.example.example_places(folder), force=force)
        dic.example.write_example(folder)
    except OSError as error:
        raise OutputError(
            str(folder),
            "write example",
            "a folder that can be written to",
            error.strerror or str(error),
            "name another folder",
        ) from error
    say(f"{folder}: a tension test of an aluminium sheet in 16 steps")
    width = max(map(len, dic.example.FILES))
    for name, meaning in dic.example.FILES.items():
        if meaning:
            say(f"  {name:<{width}}  {meaning}")
        elif name == "step-01.png":
            say(f"  {'step-NN.png':<{width}}  the same under load, NN = 01 to 16; truth.json has the strains")
    say("try next:")
    for command in NEXT:
        say(f"  {command.format(shlex.quote(str(folder)))}")
