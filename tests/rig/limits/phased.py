"""Tests with phases (preload, cycles, holds, unloading) for the specimens and machines of `lies`."""

import random
import tomllib
from dataclasses import dataclass
from typing import Any

from drivers.settings import toml_table
from tests.rig.limits.lies import MATERIALS, Case, draw


@dataclass
class PhasedCase(Case):
    """A case whose protocol is a list of phases.

    Attributes
    ----------
    only : tuple of str
        The kinds of phases in the protocol; all kinds if empty.
    """

    only: tuple[str, ...] = ()

    def protocol(self) -> str:
        table = tomllib.loads(super().protocol())
        increment_n = self.increment_n
        low_n, rate_n_s = 0.2 * increment_n, increment_n / 10.0
        # The rig of `lies` moves by 20 mm.
        total_mm = min(1.0 + (MATERIALS[self.material][3] + 0.02) * self.length_mm, 19.5)
        speed_mm_s = total_mm / 60.0
        table["limits"]["displacement_max_mm"] = total_mm + 0.2
        plastic = table["loading"]["plastic"]
        phases: list[dict[str, Any]] = [
            {"do": "preload", "load_n": 0.2 * increment_n, "rate_n_s": rate_n_s},
            {"do": "cycles", "low_n": low_n, "high_n": increment_n, "rate_n_s": rate_n_s, "count": 3},
            {"do": "to-load", "load_n": 2 * increment_n, "rate_n_s": rate_n_s, "images": {"every_s": 4.0}},
            {"do": "hold", "keep": "load", "rate_n_s": rate_n_s, "duration_s": 30.0},
            {
                "do": "to-load",
                "load_n": (self.increments + 3) * increment_n,
                "rate_n_s": rate_n_s,
                "images": {"every_n": increment_n},
                "until": {"plastic": plastic},
            },
            {"do": "to-displacement", "displacement_mm": total_mm, "speed_mm_s": speed_mm_s},
            {"do": "hold", "keep": "displacement", "duration_s": 30.0},
            {"do": "unload", "rate_n_s": rate_n_s},
        ]  # fmt: skip
        chosen = [phase for phase in phases if not self.only or phase["do"] in self.only]
        tables = {name: table[name] for name in ("sample", "settle", "limits", "plausible") if name in table}
        tables["start"] = {"tare_max_n": table["loading"]["tare_max_n"] * 0.2}
        head = 'kind = "phases"\ntitle = "a test of phases"'
        listed = ["[" + toml_table(["phases"], phase).replace("]", "]]", 1) for phase in chosen]
        return (
            "\n\n".join([head, *listed, *(toml_table([name], each) for name, each in tables.items())]) + "\n"
        )


def draw_phased(rng: random.Random) -> PhasedCase:
    """Return a random specimen and machine, in the same way as `draw`."""
    case = draw(rng)
    return PhasedCase(
        case.material,
        case.width_mm,
        case.thickness_mm,
        case.length_mm,
        case.machine_n_mm,
        case.slip_mm,
        case.increments,
        case.seed,
    )
