"""The live measurement of one camera: the gauges in each frame, one frame after the other."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.errors import CorrelationError, GaugeError
from dic.gauges.field import GaugeField
from dic.image.stored import StoredImage
from dic.live.corrected import CorrectedField
from dic.live.fields import LiveFields
from dic.live.frames import FrameChecks
from dic.live.gauges import FollowedGauge
from dic.live.image import LiveGauge, LiveImage
from dic.live.motion import VALUES, FieldMotion, MotionTrack, SharedErrors
from dic.live.points import GaugePoints
from dic.live.reasons import Reason
from dic.live.search import LostPoints
from dic.live.setup import LiveSetup
from dic.live.sought import LostPlaces, Sought
from dic.live.tracking import Tracker
from dic.typing import Float

_INTERPOLATION_PX = 21
"""Number of pixels around a subset that its interpolation needs."""


@dataclass(frozen=True)
class MotionNow:
    """The motion out of the plane at the time of a frame."""

    values: Float = field(default_factory=lambda: np.zeros(VALUES))
    """Shape (9,). Slopes and shift of the plane, and terms of the bend; see `FieldMotion.values`."""
    errors: SharedErrors | None = None
    """Errors of the strains; None if the motion is not known."""
    covariance: Float = field(default_factory=lambda: np.zeros((VALUES, VALUES)))
    """Shape (9, 9). Errors of the values, by the age of the motion and by noise."""
    more: Float = field(default_factory=lambda: np.zeros((3, 3)))
    """Shape (3, 3). Covariance of errors of exx, eyy, exy that these errors cause."""
    age_s: float = float("nan")
    reason: Reason = Reason.NONE
    """Why corrected strain is not valid."""


class LiveCamera:
    """Measure the gauges of one camera in each frame.

    All that does not depend on the frame is computed beforehand. A frame takes about as long as the
    correlation of the gauges' points.

    Parameters
    ----------
    setup : LiveSetup
    best_only : bool
        True if `LiveGauge.readings` shall have the raw and the best kind only, which saves time.

    Raises
    ------
    GaugeError
        If a gauge lies outside the image or where the reference has no points.
    CorrelationError
        If the reference cannot be used.
    """

    def __init__(self, setup: LiveSetup, *, best_only: bool = False) -> None:
        self.setup, self._best_only = setup, best_only
        prepared, at_rest = setup.correlator.prepared, setup.at_rest
        around_px = prepared.settings.radius_px + _INTERPOLATION_PX + setup.live.room_px
        self.points = GaugePoints.of(prepared, setup.needed, around_px)
        self._shape = setup.reference.shape
        self.tracker = Tracker(prepared, self.points, self._shape, setup.live)
        self.fields = LiveFields(at_rest, prepared, self.points, setup.calibration)
        image = StoredImage(np.asarray(setup.reference), prepared.smoothing.taps)
        self._lost = LostPoints(prepared, image, self.tracker, setup.live.search_px)
        self._gauges = [
            FollowedGauge(gauge, placed, self.points, prepared.settings.radius_px, setup.live)
            for gauge, placed in zip(setup.gauges, setup.placed.placed, strict=True)
        ]
        groups = [numbers for gauge in self._gauges for numbers in gauge.groups]
        self._checks = FrameChecks(setup.reference, self.tracker, groups)
        self.corrected: CorrectedField | None = None
        if setup.calibration is not None and setup.calibration.pinhole is not None:
            self.corrected = CorrectedField(self.fields, at_rest, setup.calibration)
        if setup.at_rest_errors is not None:
            self.fields.share(setup.at_rest_errors)
        self.track: MotionTrack | None = None
        self._motion: FieldMotion | None = None
        self._is_new = False
        self._times_s: list[float] = []
        self._last: LiveImage | None = None

    def __repr__(self) -> str:
        return f"LiveCamera({self.setup}, {self.points})"

    def measure(self, image: NDArray[Any], time_s: float) -> LiveImage:
        """Return the readings of all gauges in the next frame.

        Parameters
        ----------
        image : ndarray, shape (height, width)
            Grey levels. The array is read only during the call.
        time_s : float
            Time of the frame, on any clock that runs on.

        Raises
        ------
        CorrelationError
            If the frame has another shape than the reference, or is no image of grey levels.
        """
        reason = self.locate(image, time_s)
        return self.read(image, time_s, reason)

    def locate(self, image: NDArray[Any], time_s: float) -> Reason:
        """Find the points of the gauges in the next frame; return why the frame is not valid."""
        self._require_frame(image)
        times_s = self._times_s
        if times_s and (not time_s > times_s[-1] or self._checks.repeated(image)):
            return Reason.REPEATED
        self._times_s = times_s = [*times_s[-2:], time_s]
        ratio = 1.0
        if len(times_s) == 3:
            ratio = (times_s[2] - times_s[1]) / (times_s[1] - times_s[0])
        if self.track is None:
            self.track = MotionTrack(time_s)
        self.tracker.follow(image, ratio)
        self.fields.take(self.tracker)
        if self.corrected is not None:
            self.corrected.take()
        return Reason.NONE

    def read(
        self, image: NDArray[Any], time_s: float, reason: Reason, motion: "MotionNow | None" = None
    ) -> LiveImage:
        """Return the readings of the frame that was located last.

        `reason`: result of `locate`. `motion`: the motion out of the plane. Default: what the motions of the
        fields let expect.
        """
        if reason:
            gauges = {} if self._last is None else self._last.gauges
            again = {name: replace(gauge, reason=reason, figures="") for name, gauge in gauges.items()}
            return LiveImage(time_s, again, reason)
        motion = motion or self.motion_now(time_s)
        fields, unusable = self._fields(motion)
        more_saturated, left_contrast = self._checks.light(image)
        bright = iter(more_saturated > self.setup.live.most_saturated)
        faint = iter(left_contrast < self.setup.live.least_contrast)
        status = self.tracker.status[self.points.points]
        valid, gauges = self.fields.valid, {}
        for gauge in self._gauges:
            readings = {kind: gauge.read(kind, field, valid) for kind, field in fields.items()}
            why, figures = gauge.objection(valid, status, readings["raw"], time_s)
            # Every group takes its own items of both iterators.
            if sum([next(faint) for _ in gauge.groups]) and not why:
                why, figures = Reason.FAINT, ""
            if sum([next(bright) for _ in gauge.groups]):
                why, figures = Reason.SATURATED, ""
            name = gauge.gauge.name
            gauges[name] = LiveGauge(name, readings, why, unusable, figures)
        self._last = LiveImage(time_s, gauges, Reason.NONE, motion.age_s, self._ends(image))
        return self._last

    def pass_over(self, image: NDArray[Any], time_s: float, reason: Reason) -> LiveImage:
        """Read no gauge in the frame that was located last, but do all that the next frame needs.

        `reason`: result of `locate`.
        """
        return LiveImage(time_s, {}, reason, lost=0 if reason else self._ends(image))

    def take(self, motion: FieldMotion) -> None:
        """Take the motion out of the plane that a whole field has shown, for the next frames.

        Raises
        ------
        GaugeError
            If the camera has no calibration with a pinhole model.
        """
        if self.corrected is None:
            raise GaugeError(
                "live gauges",
                "correct for motion out of the plane",
                "a calibration with a pinhole model",
                "a camera without one",
                "calibrate the camera with an image of the grid, and give calibration=…",
            )
        self._motion, self._is_new = motion, True
        self.fields.share(motion.errors.calibrated)
        if motion.centre_mm is not None and not motion.declined:
            self.corrected.centre_mm = motion.centre_mm

    def motion_now(self, time_s: float) -> MotionNow:
        """Return the motion out of the plane that the motions of the fields let expect now."""
        track = self.track
        if track is not None and self._is_new and self._motion is not None and self.corrected is not None:
            # The derivatives are those of a frame, so a motion is taken with the next one.
            track.take(self._motion, self.corrected.by_values(self._motion.values))
            self._is_new = False
        if track is None or track.last is None:
            declined = self._motion is not None
            return MotionNow(reason=Reason.DECLINED if declined else Reason.NO_MOTION)
        age_s = track.age_s(time_s)
        reason = Reason.OLD if age_s > self.setup.live.most_age_s else Reason.NONE
        if self._motion is not None and self._motion.declined:
            reason = Reason.DECLINED
        values, covariance = track.at(time_s)
        more = track.by_values @ covariance @ track.by_values.T
        return MotionNow(values, track.last.errors, covariance, more, age_s, reason)

    @property
    def lost(self) -> LostPlaces:
        """The points that had no displacement in the last frame, for `FieldSolver.seek`."""
        at = self.points.points[~self.tracker.known]
        return LostPlaces(self.points.rows[at], self.points.columns[at])

    def accept(self, sought: Sought) -> None:
        """Let the next frame start from points that a search has found, if they are lost still."""
        places, lost = self.points.numbers, ~self.tracker.known
        pairs = zip(sought.rows.tolist(), sought.columns.tolist(), strict=True)
        found = [(places[place], j) for j, place in enumerate(pairs) if place in places]
        found = [(k, j) for k, j in found if lost[k]]
        if found:
            numbers, which = np.array(found).T
            self.tracker.place(numbers, sought.warps[which])

    def _ends(self, image: NDArray[Any]) -> int:
        """Do what the next frame needs; return the number of lost tiles."""
        self._checks.keep(image)
        return self._lost.search(image)

    def _fields(self, motion: MotionNow) -> tuple[dict[str, GaugeField], dict[str, Reason]]:
        """Return the fields that gauges can read, and why the corrected one must not be used."""
        fields = {"raw": self.fields.raw}
        corrects = self.setup.motion is not None and self.corrected is not None
        if self.fields.calibrated is not None and not (corrects and self._best_only):
            fields["calibrated"] = self.fields.calibrated
        if self.setup.motion is None or self.corrected is None:
            return fields, {}
        if motion.errors is not None:
            fields["corrected"] = self.corrected.field(motion.values, motion.errors, motion.more)
        # Before a second field it is not known how fast the motion goes on.
        reason = motion.reason or (Reason.NONE if np.isfinite(motion.more).all() else Reason.NO_MOTION)
        return fields, {"corrected": reason} if reason else {}

    def _require_frame(self, image: NDArray[Any]) -> None:
        good = isinstance(image, np.ndarray) and image.shape == self._shape and image.dtype.kind in "uif"
        if not good:
            height, width = self._shape
            got = f"a {type(image).__name__}"
            if isinstance(image, np.ndarray):
                got = f"an array of shape {image.shape} and type {image.dtype}"
            raise CorrelationError(
                "live frame",
                "compare with the reference",
                f"grey levels of {width} x {height} px",
                got,
                "stream the frames with the readout and the format of the reference image",
            )
