"""Pull the virtual rig in real time at a strain rate, with two cameras of 2048 x 2048 px at 10 images/s.

    python -m benchmarks.continuous --seconds 300 --folder /data

The virtual rig of examples/rig-virtual-continuous.toml draws the frames in the same process, so that its work
counts too. The images of 5 minutes have 25 GB. Printed are lost and missing frames, the rate of the live
gauges, their time from the middle of the exposure to the value, the strain rate, and memory. The exit status
is 1 if an image was lost or late, the gauges were slower than 9 values/s, or memory grew.
"""

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from benchmarks.acquire import MemoryLog
from benchmarks.endurance import GROWTH_MAX_MB
from dic.runfile.digests import frame_digest
from rig import run_protocol
from rig.engine.status import EngineStatus

INTERVAL_S, RATE_S, LENGTH_MM = 0.1, 0.00025, 60.0
RIG = Path(__file__).parents[1] / "examples" / "rig-virtual-continuous.toml"
PROTOCOL = """
kind = "phases"
title = "benchmark"
sample = {{ name = "sheet", thickness_mm = 1.0, width_mm = 25.0, gauge_length_mm = 60.0 }}
start.tare_max_n = 100.0
images = {{ still = 0, timeout_s = 60.0 }}
[settle]
load_tolerance_n = 20.0
displacement_tolerance_mm = 0.002
dwell_s = 0.5
timeout_s = 30.0
poll_s = 0.02

[limits]
load_max_n = 19000.0
displacement_max_mm = 19.0
break_load_drop = 0.5

[live]
gauges = [
    "axial=extensometer unit=mm start=0,-3 end=0,3 patch=1",
    "across=extensometer unit=mm start=-3,0 end=3,0 patch=1",
]
subset_px = 31

[[phases]]
do = "preload"
load_n = 200.0
rate_n_s = 100.0

[[phases]]
do = "pull"
displacement_mm = 18.0
images.every_s = {interval_s}

[[phases.stages]]
strain_rate_s = {rate_s}
gauge = "axial"
parallel_length_mm = {length_mm}
until.duration_s = {seconds}
"""


def pull(folder: Path, seconds: float) -> dict[str, Any]:
    """Run the test, check the file, and return the measured values."""
    protocol, rig, path = folder / "pull.toml", folder / "rig.toml", folder / "run.h5"
    protocol.write_text(
        PROTOCOL.format(interval_s=INTERVAL_S, rate_s=RATE_S, length_mm=LENGTH_MM, seconds=seconds)
    )
    text = RIG.read_text().replace(
        'driver = "virtual-rig"\n', 'driver = "virtual-rig"\nreal_time = true\n', 1
    )
    rig.write_text(text + "duration_s = 0.0\n")
    memory, shown = MemoryLog(), []

    def see(status: EngineStatus) -> None:
        if status.live is not None:
            shown.append(status.live)
            if not memory.is_alive() and not memory.values_mb:
                memory.start()

    outcome = run_protocol(protocol, rig, path, on_status=[see])
    memory.ended.set()
    timing = outcome.timing
    if timing is None or not shown or not memory.values_mb:
        sys.exit(f"no continuous test: {outcome.reason}")
    return {
        "seconds": seconds,
        "status": outcome.status,
        "reason": outcome.reason,
        **timing.as_dict(),
        "stream_lost": max((live.lost for live in shown), default=0),
        "not_measured": shown[-1].left_out if shown else 0,
        "memory_mb": [round(min(memory.values_mb), 1), round(max(memory.values_mb), 1)],
        "memory_growth_mb": round(memory.growth_mb, 1),
        "file_gb": round(path.stat().st_size / 1e9, 2),
        **check(path, seconds),
    }


def check(path: Path, seconds: float) -> dict[str, Any]:
    """Compare every image with its digest, and return rate, delay and strain rate of the gauge."""
    damage = []
    with h5py.File(path) as file:
        live = file["entry/channels/live_gauges"]
        time_s, latency_s = live["time_s"][()], live["value_gauge_latency"][()]
        strain = live["value_gauge.axial"][()]
        images = {}
        for name in ("on_axis", "off_axis"):
            group = file[f"entry/instrument/{name}"]
            images[name] = len(group["sequence"])
            for row in range(images[name]):
                if group["digest"][row].decode() != frame_digest(group["data"][row]):
                    damage.append(f"{name}: image {row} has a wrong digest")
    valid = np.isfinite(strain)
    # The rate is reached some seconds after the beginning.
    steady = valid & (time_s > time_s[-1] - 0.8 * seconds)
    whole = np.arange(time_s[steady][0], time_s[steady][-1], 1.0)
    per_s = np.diff(np.interp(whole, time_s[steady], strain[steady]))
    return {
        "images": images,
        "damage": damage[:10],
        "values_per_s": round((len(time_s) - 1) / (time_s[-1] - time_s[0]), 2),
        "valid_share": round(float(valid.mean()), 4),
        "value_after_exposure_ms": [
            round(float(1e3 * np.percentile(latency_s, each)), 1) for each in (50, 99)
        ],
        "strain_rate": [
            round(float(each) / RATE_S, 3)
            for each in (per_s.mean(), np.percentile(per_s, 1), np.percentile(per_s, 99))
        ],
    }


def is_good(figures: dict[str, Any]) -> bool:
    """Return True if nothing is lost, late or damaged, the gauges kept their rate, and memory its size."""
    return (
        figures["status"] == "completed"
        and figures["late"] == figures["missing"] == figures["stream_lost"] == 0
        and not figures["damage"]
        and figures["values_per_s"] > 9.0
        and figures["memory_growth_mb"] < GROWTH_MAX_MB
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--folder", type=Path, help="where to write; a temporary folder by default")
    parser.add_argument("--seconds", type=float, default=60.0)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=given.folder) as folder:
        figures = pull(Path(folder), given.seconds)
    print(json.dumps(figures, indent=2))
    sys.exit(not is_good(figures))


if __name__ == "__main__":
    main()
