"""The output of `rig replay`: the lines to print, and a table for JSON."""

from typing import Any

from rig import Replay


def replay_lines(replay: Replay) -> list[str]:
    """Return the result of a replay as lines of text."""
    counts = f"{replay.images} images, {replay.readings} readings, {replay.steps} steps"
    ended = f"{replay.outcome.status}, the run was {replay.recorded_status}"
    verdict = "identical with the run" if not replay.differences else "different from the run"
    lines = [f"{counts}: {verdict}", f"the replay ended as {ended}"]
    if replay.outcome.reason:
        lines.append(f"reason: {replay.outcome.reason}")
    return lines + [f"different: {difference}" for difference in replay.differences]


def replay_dict(replay: Replay) -> dict[str, Any]:
    """Return the result of a replay as a table for JSON."""
    return {
        "status": replay.outcome.status,
        "reason": replay.outcome.reason,
        "recorded_status": replay.recorded_status,
        "images": replay.images,
        "readings": replay.readings,
        "steps": replay.steps,
        "identical": not replay.differences,
        "differences": replay.differences,
    }
