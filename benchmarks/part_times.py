"""Which part of a command of `dic` takes how much processor time?

    python -m benchmarks.part_times correlate reference.png img.png -o results.h5

Each function of `PARTS` counts the processor time of its own thread without that of other such functions
inside it. The last line that the program prints is JSON with the time of each part, s, of "starting" (until
the command begins, with all modules that `PARTS` names) and of the "whole" program.
"""

import functools
import importlib
import json
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

PARTS = {
    "images": ("dic.image.read:read_image",),
    "splines": (
        "dic.correlation.laid_rows:LaidReference.__init__",
        "dic.correlation.laid_rows:LaidDeformed.__init__",
    ),
    "search": ("dic.correlation.correlator:Correlator._first_seeds",),
    "kernel": ("dic.correlation.kernel.propagation:_run",),
    "strain, sigma": ("dic.pipeline.measured:measure", "dic.strain.strain:strain_field"),
    "corrections": ("dic.pipeline.corrections:Corrector.corrected",),
    "result file": (
        "dic.pipeline.result_writer:MeasurementWriter.__enter__",
        "dic.pipeline.result_writer:MeasurementWriter.add_field",
        "dic.pipeline.result_writer:MeasurementWriter.add_step",
        "dic.pipeline.result_writer:MeasurementWriter.commit_if_due",
        "dic.pipeline.result_writer:MeasurementWriter.finish",
    ),
    "maps": ("dic.derived.series_maps:SeriesMaps.add", "dic.derived.series_maps:SeriesMaps.draw"),
    "tables": ("dic.results.csv:write_csv",),
}
"""The functions of each part, as module:name. A function that does not exist ends the benchmark."""


class PartTimes:
    """The processor time of each part, which its functions count while they run."""

    def __init__(self) -> None:
        self.times_s: Counter[str] = Counter()
        self._running = threading.local()
        self._lock = threading.Lock()

    def count(self, place: str, part: str) -> None:
        """Let the function at `place` (module:name) count its time as that of `part`."""
        module, name = place.split(":")
        owner: Any = importlib.import_module(module)
        *classes, last = name.split(".")
        for each in classes:
            owner = getattr(owner, each)
        function = getattr(owner, last)
        counted = self._counted(function, part)
        setattr(owner, last, counted)
        for other in list(sys.modules.values()) if not classes else ():
            if other.__name__.startswith("dic") and vars(other).get(last) is function:
                setattr(other, last, counted)

    def _counted(self, function: Callable[..., Any], part: str) -> Callable[..., Any]:
        @functools.wraps(function)
        def counted(*args: Any, **options: Any) -> Any:
            stack = self._running.__dict__.setdefault("inner_s", [])
            stack.append(0.0)
            began_s = time.thread_time()
            try:
                return function(*args, **options)
            finally:
                took_s = time.thread_time() - began_s
                own_s = took_s - stack.pop()
                if stack:
                    stack[-1] += took_s
                with self._lock:
                    self.times_s[part] += own_s

        return counted


def run(words: list[str]) -> None:
    """Run `dic` with `words` in this process, and print the time of each part as JSON, the last line."""
    parts = PartTimes()
    for part, places in PARTS.items():
        for place in places:
            parts.count(place, part)
    start_s = time.process_time()
    from dic.cli import main as dic

    sys.argv = ["dic", *words]
    try:
        dic()
    except SystemExit as end:
        if end.code:
            raise
    whole_s = time.process_time()
    print(json.dumps({"starting": start_s, **parts.times_s, "whole": whole_s}))


if __name__ == "__main__":
    run(sys.argv[1:])
