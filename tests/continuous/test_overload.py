"""A load cell that lies in a pull loads a specimen no further than it does in steps of load."""

import pytest

from tests.continuous.overloads import INCREMENT_N, drive_lying

LIES = ("stuck-load", "tenth-load", f"drifting-load:{round(0.05 * INCREMENT_N)}")
READING = 0.02
"""Share of an increment by which a pull may go further: 0.2 s of loading, as each has its own readings."""
DRIFTED = 0.25
"""A drift that begins just before a rest shows there at once. A pull has no rest, and needs this share."""


@pytest.mark.parametrize(
    "lie", [LIES[2], *(pytest.param(lie, marks=pytest.mark.extended) for lie in LIES[:2])]
)
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.long) for seed in range(1, 8))])
def test_the_overload_of_a_pull_is_no_larger_than_that_of_steps(lie, seed, tmp_path):
    steps = drive_lying(tmp_path / "steps", lie, seed, steps=True)
    pull = drive_lying(tmp_path / "pull", lie, seed, steps=False)
    print(
        f"{lie}: beyond the load at which it began, steps {steps.beyond_n / INCREMENT_N:.3f}, "
        f"pull {pull.beyond_n / INCREMENT_N:.3f} of an increment"
    )
    assert (steps.status, pull.status) == ("failed", "failed")
    least = DRIFTED if lie.startswith("drifting") else 0.0
    assert pull.beyond_n <= max(steps.beyond_n + READING * INCREMENT_N, least * INCREMENT_N)
