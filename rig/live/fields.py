"""Whole fields beside the live gauges: the motion out of the plane, and points that are lost."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

if TYPE_CHECKING:
    from dic.live import FieldMotion, LiveSetups, LostPlaces, Sought
    from rig.live.frame_ring import RingShape
    from rig.live.measuring import Measuring

Images = Mapping[str, NDArray[Any]]
READY = "ready"
_FIRST_S = 0.1
"""Time from the first frame to the first one of which a field is solved."""

LATE = "the frame was replaced by newer ones"


@dataclass(frozen=True)
class FieldsGiven:
    """The first message to the process that solves fields: descriptors that it inherits.

    Attributes
    ----------
    setups, size : int
        Descriptor of the memory with the pickled `LiveSetups`, and the number of their bytes.
    rings : mapping of str to (RingShape, int)
        Shape and descriptor of the ring of each camera.
    """

    setups: int
    size: int
    rings: "Mapping[str, tuple[RingShape, int]]"


@dataclass(frozen=True)
class FieldTask:
    """What is asked of a frame: the motion out of the plane of these cameras, or their lost points.

    Attributes
    ----------
    frames : mapping of str to int
        Numbers of the frames, by camera.
    time_s : float
    lost : LostPlaces or None
        Points of the only camera that are searched; None to solve the field.
    """

    frames: Mapping[str, int]
    time_s: float
    lost: "LostPlaces | None" = None


@dataclass(frozen=True)
class FieldAnswer:
    """The answer to a task; `problem` says why there is none."""

    task: FieldTask
    motions: "Mapping[str, FieldMotion]" = field(default_factory=dict)
    sought: "Sought | None" = None
    problem: str = ""

    def give_to(self, measuring: "Measuring") -> None:
        """Let the next frames use the answer."""
        if self.task.lost is None:
            declined = next((each.declined for each in self.motions.values() if each.declined), "")
            measuring.field_problem = self.problem or declined
        measuring.take(self.motions)
        if self.sought is not None:
            (camera,) = self.task.frames
            measuring.accept(camera, self.sought)


class FieldTasks:
    """Chooses the next task: fields of all cameras in turn, and between them a search of lost points.

    Parameters
    ----------
    setups : LiveSetups
    every_s : float
        Least time between the starts of two fields.
    """

    def __init__(self, setups: "LiveSetups", every_s: float) -> None:
        self._every_s = every_s
        pair = [] if setups.pair is None else [setups.pair]
        alone = [
            (name,)
            for name, setup in setups.cameras.items()
            if name not in (setups.pair or ()) and setup.motion is not None
        ]
        self.groups: list[tuple[str, ...]] = [*pair, *alone]
        self._began_s: float | None = None
        self._searched = False

    def next(
        self, numbers: Mapping[str, int], time_s: float, measuring: "Measuring", now_s: float
    ) -> FieldTask | None:
        """Return a task for the frames that were measured last, None if nothing is to be done.

        `numbers`: the numbers of the frames by camera. `time_s`: their time for the measurement.
        """
        lost = {name: each for name, each in measuring.lost().items() if name in numbers}
        if lost and not self._searched:
            self._searched = True
            name = next(iter(lost))
            return FieldTask({name: numbers[name]}, time_s, lost[name])
        self._searched = False
        if self._began_s is None:
            # A field of the very first frame would not tell how the motion goes on.
            self._began_s = now_s + min(_FIRST_S - self._every_s, 0.0)
        if now_s - self._began_s < self._every_s:
            return None
        group = next((each for each in self.groups if numbers.keys() >= set(each)), None)
        if group is None:
            return None
        self._began_s = now_s
        self.groups.remove(group)
        self.groups.append(group)
        return FieldTask({name: numbers[name] for name in group}, time_s)


class FieldWork:
    """Does the tasks.

    Parameters
    ----------
    setups : LiveSetups
    """

    def __init__(self, setups: "LiveSetups") -> None:
        from dic.live import FieldSolver, PairSolver

        self._setups = setups
        self._solvers: dict[str, FieldSolver] = {}
        self._pair: PairSolver | None = None
        if setups.pair is not None:
            first, second = (setups.cameras[name] for name in setups.pair)
            self._pair = PairSolver(first, second, setups.surface)
            self._solvers = dict(zip(setups.pair, self._pair.solvers, strict=True))
        for name in setups.cameras.keys() - self._solvers.keys():
            self._solvers[name] = FieldSolver(setups.cameras[name])

    def done(self, task: FieldTask, images: Images) -> FieldAnswer:
        """Do a task with the pixels of its frames."""
        import dic

        try:
            if task.lost is not None:
                ((camera, image),) = images.items()
                return FieldAnswer(task, sought=self._solvers[camera].seek(image, task.lost))
            return FieldAnswer(task, self._motions(images, task.time_s))
        except dic.MeasurementError as error:
            # A covered lens, for example: the last field holds, and its age says how long.
            return FieldAnswer(task, problem=f"the last field: {error.got}")

    def warm_up(self) -> None:
        """Solve the references, so that all code is compiled and loaded."""
        references = {name: setup.reference for name, setup in self._setups.cameras.items()}
        tasks = FieldTasks(self._setups, 0.0)
        for group in tasks.groups:
            self.done(FieldTask(dict.fromkeys(group, 0), 0.0), {name: references[name] for name in group})

    def _motions(self, images: Images, time_s: float) -> "dict[str, FieldMotion]":
        pair = self._setups.pair
        if self._pair is not None and pair is not None and images.keys() == set(pair):
            both = self._pair.solve((images[pair[0]], images[pair[1]]), time_s)
            return dict(zip(pair, both, strict=True))
        return {name: self._solvers[name].solve(image, time_s) for name, image in images.items()}
