"""Check at every reading of a tension test that load and displacement agree.

The controller of a load frame cannot know whether its load cell shows the real load. If the load cell shows
too little, the controller moves on to a limit of the displacement, and the specimen carries many times the
commanded load. This module checks whether a correct load cell could show the load of each reading at its
displacement.
"""

import math
from dataclasses import replace

from rig.errors import ImplausibleReading
from rig.limits.following import Following, History
from rig.limits.noise import ReadingNoise, Rest
from rig.limits.stiffness import LoadStringBounds
from rig.protocol.conditions import Pull, Zeroing
from rig.protocol.step import ProtocolStep, RigReading

DROP_SHARE = 0.05
"""While the crosshead pulls, a fall of the load by this fraction of an increment is an error."""
_SIGMAS = 4.0
_NOISE_MIN_SHARE = 0.0002
_NOISE_DEFAULT_SHARE = 0.2
_DRIFT_SHARE = 0.01
_DRIFT_SIGMAS = 5.0
_SOFTENING, _SOFTENING_MARGIN = 0.05, 0.03
"""An increment that should be elastic may be softer than the stiffest increment by the first fraction.

The second value is a margin, as a fraction of the increment's load.
"""
_YIELDED_SHARE = 0.02
"""Smallest load of a yielded specimen, as a fraction of an elastic specimen's load at equal displacement.

The bound is valid even at a strain of tens of percent.
"""
_REST_MIN_S = 0.5
_REST_EVERY = 10
_STUCK_READINGS = 5
_LOOK = (
    "look at the specimen, then check the load cell, its cable and the displacement transducer before "
    "anything moves again"
)


class Agreement:
    """Compares load and displacement at every reading of a test with a load frame.

    `string` is the plausible behaviour of the load string, and `pull` has the loads of the test. The
    tolerances of `zeroing` limit the noise that is measured at rest.
    """

    def __init__(self, string: LoadStringBounds, pull: Pull, zeroing: Zeroing) -> None:
        self._string = string
        self._pull = pull
        self._increment_n = pull.increment_n
        self._tolerances = (zeroing.load_tolerance_n, zeroing.displacement_tolerance_mm)
        self._noise, self._rest = ReadingNoise(), Rest()
        self._zero: RigReading | None = None
        self._last: RigReading | None = None
        self._step: ProtocolStep | None = None
        self._start: RigReading | None = None
        self._following: Following | None = None
        self._verified = False
        self._was_moving = False
        self._tared = False
        self._history = History()
        self._secant_n_mm: float | None = None
        self._highest_n = 0.0
        self._reached_n = -math.inf
        self._of_step_n = pull.increment_n
        self._peak_n = 0.0
        self._same = 0

    def tared(self) -> None:
        """Delete the earlier readings, because load and displacement were set to zero."""
        self._zero = None
        self._tared = True
        self._rest.clear()
        self._noise.interrupt()

    def begin(self, step: ProtocolStep) -> None:
        """Begin a step of the protocol. The last reading becomes the start of the step's motion.

        Raise `ImplausibleReading` if the load drifted before the step, although everything stood still.
        """
        if self._tared and self._last is not None and step.pulls:
            self._check_drift(self._last, str(step))
        if self._start is not None and self._last is not None and self._step is not None:
            self._learn(self._last)
        self._step, self._start, self._following, self._same = step, None, None, 0
        self._was_moving = True

    def check(self, reading: RigReading, step: str) -> None:
        """Check one reading.

        Raise `ImplausibleReading` if no correct load cell could show this load at this displacement.
        """
        if self._zero is None:
            self._zero = reading
        commanded = self._step is not None and self._step.pulls
        # The first reading after a motion command, and the first reading at rest, also belong to the motion.
        if commanded and (reading.moving or self._was_moving):
            self._was_moving = reading.moving
            self._check_motion(reading, step)
            self._noise.interrupt()
            self._rest.clear()
        elif self._step is not None and self._step.holds:
            # Readings of a hold show no noise at rest: the specimen creeps or relaxes, or the load is
            # corrected.
            self._noise.interrupt()
            self._rest.clear()
        else:
            self._noise.add(reading)
            self._rest.add(reading)
            if self._tared and self._rest.count % _REST_EVERY == 0:
                self._check_drift(reading, step)
        self._last = reading

    @property
    def noise_n(self) -> float:
        """Noise of the load in N: the standard deviation at rest, limited to plausible values."""
        bound_n = self._tolerances[0] * _NOISE_DEFAULT_SHARE
        least_n = min(_NOISE_MIN_SHARE * self._increment_n, bound_n)
        return min(max(self._noise.load_n(bound_n), least_n), bound_n)

    @property
    def noise_mm(self) -> float:
        """Noise of the displacement in mm: the standard deviation at rest, limited to plausible values."""
        bound_mm = self._tolerances[1] * _NOISE_DEFAULT_SHARE
        return min(self._noise.displacement_mm(bound_mm), bound_mm)

    def _check_motion(self, reading: RigReading, step: str) -> None:
        assert self._zero is not None
        if self._start is None:
            self._start_motion(self._last or reading)
        assert self._start is not None
        assert self._step is not None
        outward = self._outward()
        self._check_not_stuck(reading, step)
        self._check_stiffest(reading, step)
        if outward > 0.0:
            if not self._verified:
                self._check_softest(reading, step)
            if self._step.quantity == "load" and self._step.event is None:
                self._check_drop(reading, step)
            self._check_softening(reading, step)
        self._reached_n = max(self._reached_n, reading.load_n)
        if self._following is not None and (self._step.quantity == "load" or self._is_elastic):
            self._following.check(reading, step)
        if outward * (reading.load_n - self._start.load_n) > self._increment_n:
            self._verified = True

    def _start_motion(self, start: RigReading) -> None:
        assert self._step is not None
        self._start, self._peak_n = start, start.load_n
        self._of_step_n = self._increment_n
        if self._step.quantity == "load":
            self._of_step_n = max(self._of_step_n, abs(self._step.target - start.load_n))
        in_increments = self._step.quantity == "load" and self._step.event is None
        if in_increments or (self._step.acquisition is not None and self._is_elastic):
            self._following = Following(
                start,
                outward=self._outward(),
                increment_n=self._of_step_n,
                noise_n=self.noise_n,
                noise_mm=self.noise_mm,
                history=self._history,
                elastic_n=self._pull.elastic_n,
                flow_mm=self._string.flow_mm,
                keeps_stiffness=not in_increments,
            )

    @property
    def _is_elastic(self) -> bool:
        """True if the specimen has never carried more than the load up to which it is certainly elastic.

        A pull to a displacement has no increments; so far its load must rise like that of an increment.
        """
        return self._reached_n < self._pull.elastic_n

    def _outward(self) -> float:
        assert self._step is not None
        assert self._start is not None
        return 1.0 if self._step.target >= self._step.value(self._start) else -1.0

    def _check_softest(self, reading: RigReading, step: str) -> None:
        """Check that the softest plausible specimen and machine explain the displacement at this load."""
        assert self._zero is not None
        assert self._step is not None
        margin_n, margin_mm = _SIGMAS * self.noise_n, _SIGMAS * self.noise_mm
        load_n = max(reading.load_n - self._zero.load_n + margin_n, 0.0)
        travel_mm = reading.displacement_mm - self._zero.displacement_mm
        # On the way to a displacement, the specimen may yield before it has carried an increment of load.
        elastic = self._step.quantity == "load" or travel_mm <= self._string.elastic_mm
        share = 1.0 if elastic else _YIELDED_SHARE
        greatest_mm = self._string.displacement_max_mm(load_n) / share + margin_mm
        if travel_mm > greatest_mm:
            raise ImplausibleReading(
                step,
                f"at most {greatest_mm:.4g} mm at a load of {reading.load_n:.4g} N",
                f"{travel_mm:.4g} mm: the load cell shows too little, or the specimen is too soft",
                f"{_LOOK}; if all are sound, declare the specimen's modulus with plausible.modulus_min_mpa, "
                "and slack or slip with plausible.slack_mm and plausible.seating_stiffness_n_mm",
            )

    def _check_softening(self, reading: RigReading, step: str) -> None:
        """Check that an elastic increment is as stiff as the increments before."""
        assert self._start is not None
        assert self._step is not None
        is_elastic = self._step.quantity == "load" and self._step.target <= self._pull.elastic_n
        if self._secant_n_mm is None or not is_elastic:
            return
        rise_n = max(reading.load_n - self._start.load_n, 0.0) + _SIGMAS * self.noise_n
        travel_mm = reading.displacement_mm - self._start.displacement_mm
        explained_n = rise_n / (1.0 - _SOFTENING) + _SOFTENING_MARGIN * self._of_step_n
        greatest_mm = explained_n / self._secant_n_mm + self._string.flow_mm + _SIGMAS * self.noise_mm
        if travel_mm > greatest_mm:
            raise ImplausibleReading(
                step,
                f"at most {greatest_mm:.4g} mm in this increment, as stiff as the increments before",
                f"{travel_mm:.4g} mm: the load cell drifts, or the specimen yields or slips",
                f"{_LOOK}; if it yields or slips so early, lower judged_above_n of the plastic criterion or "
                "set plausible.flow_mm",
            )

    def _check_stiffest(self, reading: RigReading, step: str) -> None:
        """Check that the stiffest plausible specimen and machine explain the change of the load."""
        assert self._start is not None
        travel_mm = abs(reading.displacement_mm - self._start.displacement_mm)
        greatest_n = (travel_mm + 2.0 * _SIGMAS * self.noise_mm) * self._string.stiffness_max_n_mm
        greatest_n += 2.0 * _SIGMAS * self.noise_n + DROP_SHARE * self._of_step_n
        change_n = self._outward() * (reading.load_n - self._start.load_n)
        if change_n > greatest_n:
            raise ImplausibleReading(
                step,
                f"a change of the load by {greatest_n:.4g} N at most over {travel_mm:.4g} mm",
                f"{change_n:.4g} N: a reading of load or displacement is wrong",
                f"{_LOOK}; if all are sound, raise plausible.modulus_max_mpa",
            )

    def _check_drop(self, reading: RigReading, step: str) -> None:
        """Check that the load does not fall while the crosshead pulls."""
        self._peak_n = max(self._peak_n, reading.load_n)
        least_n = self._peak_n - DROP_SHARE * self._of_step_n - 2.0 * _SIGMAS * self.noise_n
        if reading.load_n < least_n:
            raise ImplausibleReading(
                step,
                f"a load that rises as the crosshead pulls, above {least_n:.4g} N",
                f"{reading.load_n:.4g} N: the load cell shows too little or the wrong sign, or the specimen "
                "slips or breaks",
                _LOOK,
            )

    def _check_not_stuck(self, reading: RigReading, step: str) -> None:
        """Check that the load changes from reading to reading, because a correct load cell has noise."""
        if self._last is None or reading.load_n != self._last.load_n:
            self._same = 0
        elif abs(reading.displacement_mm - self._last.displacement_mm) > _SIGMAS * self.noise_mm:
            self._same += 1
        if self._same >= _STUCK_READINGS:
            raise ImplausibleReading(
                step,
                "a load that changes as the crosshead moves",
                f"{reading.load_n:.6g} N in {_STUCK_READINGS + 1} readings: the load reading is stuck",
                _LOOK,
            )

    def _check_drift(self, reading: RigReading, step: str) -> None:
        """Check that the load does not drift while the crosshead stands still, except for relaxation."""
        found = self._rest.drift(self.noise_n)
        if found is None or self._rest.duration_s < _REST_MIN_S:
            return
        slope_n_s, deviation_n_s = found
        relaxing_n_s = 0.0
        if slope_n_s * reading.load_n < 0.0:
            relaxing_n_s = self._string.relaxation * abs(reading.load_n) / (2.3 * self._rest.elapsed_s)
        rate_n_s = self._pull.rate_n_s or self._increment_n / self._rest.duration_s
        increment_s = self._increment_n / rate_n_s
        harmless_n_s = _DRIFT_SHARE * self._increment_n / (increment_s + self._rest.duration_s)
        greatest_n_s = max(_DRIFT_SIGMAS * deviation_n_s, harmless_n_s) + relaxing_n_s
        if abs(slope_n_s) > greatest_n_s:
            raise ImplausibleReading(
                step,
                f"a load that stands still within {greatest_n_s:.3g} N/s while nothing moves",
                f"{slope_n_s:+.3g} N/s: the load cell drifts",
                f"{_LOOK}; let the load cell warm up; if the specimen relaxes, raise plausible.relaxation "
                f"above {self._string.relaxation:g}",
            )

    def _learn(self, settled: RigReading) -> None:
        """Store the stiffness of a finished load increment for the checks of the next increments."""
        assert self._start is not None
        change_n = self._outward() * (settled.load_n - self._start.load_n)
        self._verified = self._verified or change_n > 0.5 * self._increment_n
        travel_mm = self._outward() * (settled.displacement_mm - self._start.displacement_mm)
        is_first_loading = (
            self._outward() > 0.0 and settled.load_n > self._highest_n + 0.5 * self._increment_n
        )
        if is_first_loading and change_n > 0.5 * self._increment_n and travel_mm > 0.0:
            self._secant_n_mm = max(self._secant_n_mm or 0.0, change_n / travel_mm)
        self._highest_n = max(self._highest_n, settled.load_n)
        if self._following is not None:
            self._history = self._followed(self._history, self._following, settled)

    def _followed(self, history: History, following: Following, settled: RigReading) -> History:
        """Return the known relation of load to displacement after a finished increment."""
        found = [each for each in (history.stiffness_n_mm, following.stiffness_n_mm) if each is not None]
        history = replace(history, stiffness_n_mm=max(found, default=None))
        if self._outward() < 0.0 or settled.load_n < history.highest_n:
            return history
        return replace(history, highest_n=settled.load_n, beyond_n_mm=following.tangent_n_mm)
