"""The command `dic compare`, which compares results of offaxis with results of another program."""

from __future__ import annotations

import json
from pathlib import Path

import click

import dic
from dic.files import write_text
from dic.shell.console import say
from dic.shell.output_paths import FORCE, PATH, require_places

_COLUMNS = ("points", "mean", "rms", "quantile_05", "median", "quantile_95", "largest")
_HEADINGS = ("points", "mean", "rms", "5 %", "median", "95 %", "largest")


@click.command()
@click.argument("results", type=PATH)
@click.argument("peer", type=PATH)
@click.option("--image", type=int, help="Number of the image in RESULTS, from 1. Default: the only image.")
@click.option("--camera", help="Camera of a run. Default: the only camera of the run.")
@click.option(
    "--peer-image",
    type=int,
    default=1,
    show_default=True,
    help="Number of the image in PEER, from 1, for Ncorr.",
)
@click.option(
    "--peer-strain", help="Strain measure of a file of OpenCorr: small or green-lagrange. Default: small."
)
@click.option("--picture", type=PATH, help="Picture of both results and their difference.")
@click.option("--json", "json_file", type=PATH, help="JSON file of the printed results.")
@FORCE
def compare(
    results: Path,
    peer: Path,
    image: int | None,
    camera: str | None,
    peer_image: int,
    peer_strain: str | None,
    picture: Path | None,
    json_file: Path | None,
    force: bool,
) -> None:
    """Compare RESULTS with the result file PEER of another program, at the points that both have.

    RESULTS is a result file of `dic correlate` or `dic process`. PEER is a result file of DICe (text), Ncorr
    (.mat) or OpenCorr (table of points). The command compares raw displacements and strains: values of
    offaxis minus values of PEER.

    Exit status: 0 if there are common points, 2 if not.
    """
    require_places([results, peer], [picture, json_file], force=force)
    other = dic.comparison.read_peer(peer, number=peer_image, measure=peer_strain)
    found = dic.compare_results(results, other, image=image, camera=camera, picture=picture)
    for line in _lines(found):
        say(line)
    if picture is not None:
        say(f"picture: {picture}")
    if json_file is not None:
        write_text(json_file, json.dumps(found.as_dict(), indent=1, allow_nan=False))


def _lines(found: dic.comparison.Comparison) -> list[str]:
    """Return the table of the differences, in mpx and µε."""
    share = 100.0 * found.common / len(found.peer)
    head = f"offaxis - {found.peer.program}: {found.common} of {len(found.peer)} points ({share:.1f} %)"
    lines = [head, "difference " + "".join(f"{heading:>9}" for heading in _HEADINGS)]
    for name, difference in found.differences.items():
        values = difference.as_dict()
        factor, unit = (1e3, "mpx") if name.endswith("_px") else (1e6, "µε")
        cells = [f"{values['points']:9d}"]
        for column in _COLUMNS[1:]:
            value = values.get(column)
            cells.append(f"{'':9}" if value is None else f"{factor * value:z9.1f}")
        lines.append(f"{name.removesuffix('_px')}, {unit}".ljust(11) + "".join(cells))
    return [line.rstrip() for line in lines]
