"""The limits that applied to an archived run, so that the replay ends at the same reading as the run."""

import math
import tomllib
from dataclasses import fields

from pydantic import ValidationError

from dic.runfile.reader import RunFile
from drivers.interfaces import LoadFrameLimits
from rig.limit_settings import RigLimits
from rig.replay.script import of_another_version


def limits_of_load_frame(run: RunFile) -> LoadFrameLimits:
    """Return the limits in the settings of the run's load frame. A limit that is missing is infinite."""
    asked = run.asked("load_frame").get("asked", {})
    found = {}
    for each in fields(LoadFrameLimits):
        value = asked.get(each.name)
        least = "_min_" in each.name
        known = isinstance(value, int | float) and not isinstance(value, bool)
        found[each.name] = float(value) if known else (-math.inf if least else math.inf)
    return LoadFrameLimits(**found)


def limits_of_rig(run: RunFile) -> RigLimits:
    """Return the table [limits] of the run's rig file.

    Raise `ReplayError` if this version of the program cannot read the table.
    """
    try:
        return RigLimits.model_validate(tomllib.loads(run.info.configuration).get("limits", {}))
    except (tomllib.TOMLDecodeError, ValidationError, RecursionError) as error:
        raise of_another_version(run, "rig file", error) from error
