"""The options that choose who correlates the images: threads, processes, or other computers."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import click

import dic
from dic.commands.options import Command
from dic.errors import WorkerError
from dic.shell.console import say

_CHOSEN = "dic.workers"
"""Key under which the context of a click command stores the values of these options."""


def _keep(context: click.Context, parameter: click.Parameter, value: Any) -> None:
    context.meta.setdefault(_CHOSEN, {})[parameter.name] = value


def worker_options(command: Command) -> Command:
    """Add the options of workers to a command, which reads their values with `chosen_workers`."""
    options = [
        click.option(
            "--workers",
            type=int,
            expose_value=False,
            callback=_keep,
            help="Number of processes, each of which correlates one image at a time; 1 uses one processor and"
            " no further process. The results have the same bits. Default: this process with all processors.",
        ),
        click.option(
            "--scheduler",
            metavar="ADDRESS",
            expose_value=False,
            callback=_keep,
            help="Scheduler of a Dask cluster, such as tcp://192.168.1.5:8786, whose workers correlate the"
            " images. They read the image files under the same paths as this command.",
        ),
    ]
    for option in reversed(options):
        command = option(command)
    return command


@contextmanager
def chosen_workers(settings: dic.CorrelationSettings) -> Iterator[dic.workers.Workers | None]:
    """Provide the workers that the options of the running command choose; None for `--workers 1`.

    Further processes begin to load what correlations with these settings need.

    Raises `WorkerError` if the options contradict each other, or the scheduler cannot be used.
    """
    chosen = click.get_current_context().meta.get(_CHOSEN, {})
    count, address = chosen.get("workers"), chosen.get("scheduler")
    if count is not None and address is not None:
        remedy = "leave --workers out, because the cluster has its own workers"
        raise WorkerError("settings", "workers", "--workers or --scheduler", "both", remedy)
    if address is not None:
        with dic.workers.ClusterWorkers(address) as cluster:
            yield cluster
    elif count is None:
        with dic.workers.ThreadWorker() as thread:
            yield thread
    elif count == 1:
        with dic.workers.one_processor():
            yield None
    else:
        begin = partial(dic.pipeline.load_correlation, settings)
        with dic.LocalWorkers(count, lambda lost: say(f"warning: {lost}", err=True), begin) as processes:
            yield processes
