"""Description of the computer that runs a benchmark, and a stopwatch for processor and elapsed time."""

import os
import platform
import time
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType


def describe() -> dict[str, str | int | float]:
    """Return the computer's processor, cores, widest vector instructions and load, and library versions."""
    import llvmlite.binding as llvm
    import numba
    import numpy as np

    from dic.image.threads import processors

    features = llvm.get_host_cpu_features()
    widest = next((n for n in ("avx512f", "avx2", "neon", "sse2") if features.get(n)), "none known")
    return {
        "processor": _processor(),
        "cores": processors(),
        "vectors": {"avx512f": "AVX-512", "avx2": "AVX2"}.get(widest, widest),
        "load_average": round(os.getloadavg()[0], 2),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "numba": numba.__version__,
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


@dataclass
class Stopwatch:
    """Measures the processor time of all threads and the elapsed time of a `with` block, in seconds."""

    cpu_s: float = 0.0
    wall_s: float = 0.0

    def __enter__(self) -> "Stopwatch":
        self._cpu, self._wall = time.process_time(), time.perf_counter()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.cpu_s, self.wall_s = time.process_time() - self._cpu, time.perf_counter() - self._wall
