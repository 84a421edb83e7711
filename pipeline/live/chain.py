"""From samples that arrive to residuals, frame by frame: nothing waits for what comes later."""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from time import perf_counter
from typing import Final

import numpy as np

from hbm.coordinates import LAST_Q, MOVING, N_Q, TREE, support
from hbm.ik.tracking import FrameSolution
from hbm.kernels.kernel import OneFrameKernel
from hbm.kernels.native import ONE_FRAME, kernels
from hbm.model import Body
from hbm.plausibility.outliers import MarkerTracker
from hbm.signals.filtering import RealtimeFilter
from hbm.spatial import Array, Indices, Mask, skew
from hbm.spelling import listed
from pipeline.config.live import Live
from pipeline.config.schema import Settings
from pipeline.io.recording import Plate
from pipeline.live.ground import AnalogStreams, LiveGround, Pose
from pipeline.live.stream import Samples, StreamDescription
from pipeline.trial.checks import LIMITS as CHECKS
from pipeline.trial.checks import OF_LEGS
from pipeline.trial.findings.drift import EmptyPlates
from pipeline.trial.gait.carried import PLACES, Feet, Support
from pipeline.trial.gait.contact import FEET, by_foot, pressure_beside
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.quality import Quality, settling_s
from pipeline.trial.residuals import reported


@dataclass(frozen=True, slots=True)
class LiveFrame:
    """One frame.

    Attributes
    ----------
    time
        On the streams' clock [s].
    q
        Filtered coordinates, (46,) [m and rad].
    tau
        "measured" and, with a calibration, "compensated" -> generalized forces, (46,) [N, N·m].
    residual
        The same -> residual on the pelvis in the reported axes (x forward, y right, z up) about
        mid-hip, (6,) [N, N·m].
    by_foot
        The same -> wrench under the left and the right foot, filtered, lab axes about the lab
        origin, (2, 6) [N, N·m].
    contact
        Whether a plate carries the left and the right foot, (2,).
    marker_error
        Distance of each marker from the model, (K,) [m]; NaN where it was not used.
    markers
        As received, in the order of the stream, (M, 3) [m].
    platform
        Rotation, (3, 3), and position, (3,) [m], of the platform, NaN where unknown; None where it
        stands still.
    quality
        Why it does not count.
    computing_s
        From the arrival of its last sample until it was known [s].
    """

    time: float
    q: Array
    tau: Mapping[str, Array]
    residual: Mapping[str, Array]
    by_foot: Mapping[str, Array]
    contact: Mask
    marker_error: Array
    quality: Quality
    computing_s: float
    markers: Array = field(default_factory=lambda: np.empty((0, 3)))
    platform: tuple[Array, Array] | None = None


LEGS: Final = np.union1d(*(support(LAST_Q[foot]) for foot in FEET))
MOVES: Final = np.array([np.isin(LEGS, support(LAST_Q[f])) for f in FEET]).T[:, :, None]
"""Coordinates that move a foot, (n,), and whether they move each of them, (n, 2, 1)."""
OF_PLACES: Final = np.array(
    [[12 * MOVING.index(segment) + 9 + axis for axis in range(3)] for segment in PLACES]
)
"""Numbers of the origins of these segments in what the kernel of poses gives, (5, 3)."""


ROUNDING_S: Final = 1e-6
"""Of time stamps; what lies so near the end of a reach has no weight."""


@dataclass(frozen=True, slots=True)
class _Pose:
    """What the markers of a frame show: all that needs no analog sample."""

    time: float
    position: Array
    platform: Pose | None
    q: Array
    feet: Array
    places: Array
    above: Feet | None
    needed: tuple[Array, Array, Array, Array]
    marker_error: Array
    quality: Quality


class LiveChain:
    """What `pipeline.trial.process` computes with ``filter = "realtime"``, as samples arrive.

    Parameters
    ----------
    body
        The subject.
    laboratory
        The treadmill and its calibrations.
    settings
        How trials are processed; the filter is the real-time one whatever they state.
    live
        Which streams and channels are what.
    streams
        What is received.
    plates
        Places of the plates, such as a static recording's.

    Attributes
    ----------
    wait_s
        From a frame's time to that of the last sample that it needs [s].
    filter_delay_s
        By which the filter makes coordinates, forces and residuals late [s].
    received, solved, marked
        Frames: all, those that count, and those that do not. Frames that wait for samples are only
        received.

    Raises
    ------
    ValueError
        A stream, channel or marker that is stated is not received, or the calibration does not fit.

    Notes
    -----
    A frame is computed when the last sample that it needs has arrived, or when `Live.wait_s` after
    that sample's time has passed on the streams' clock; then it is marked as late. Equal samples
    give equal frames, whatever the chunks in which they arrive.

    Examples
    --------
    >>> import pipeline
    >>> from pipeline.config.schema import Treadmill
    >>> from pipeline.virtual_lab.protocol.walking_trial import simulate_trial
    >>> _ = simulate_trial("walk.c3d", duration_s=8.0)
    >>> walk = pipeline.read_c3d("walk.c3d")
    >>> body = pipeline.process_recording(walk, pipeline.Subject(), Settings()).body
    >>> live, still, names = Live(), Laboratory(Treadmill()), walk.markers.names
    >>> labels = tuple(channel for number in (1, 2) for channel in live.channels_of(number))
    >>> streams = [
    ...     StreamDescription("Markers", "markers", names, ("m",) * len(names), 100.0),
    ...     StreamDescription("Plates", "analog", labels, 2 * (3 * ("N",) + 3 * ("Nm",)), 1000.0),
    ... ]
    >>> chain = LiveChain(body, still, Settings(), live, streams, walk.plates)
    >>> wrenches = np.hstack([plate.wrench_in_plate for plate in walk.plates])
    >>> chain.push(Samples("Plates", walk.plates[0].time[:2000], wrenches[:2000]))
    []
    >>> positions = walk.markers.position[:150].reshape(150, -1)
    >>> frames = chain.push(Samples("Markers", walk.markers.time[:150], positions))
    >>> len(frames), frames[-1].quality.counts, bool(abs(frames[-1].residual["measured"][2]) < 20)
    (150, True, True)
    """

    def __init__(
        self,
        body: Body,
        laboratory: Laboratory,
        settings: Settings,
        live: Live,
        streams: Sequence[StreamDescription],
        plates: Sequence[Plate],
    ) -> None:
        markers, analog = stated_streams(live, streams)
        self.body, self.settings, self.live, self.stream = body, settings, live, markers
        self.analog = AnalogStreams(analog)
        channels = [live.channels_of(plate.number) for plate in plates]
        self.ground = LiveGround(laboratory, settings, plates, channels, self.analog, markers)
        self.wait_s = self.ground.ahead_s
        # a Butterworth filter of second order delays low frequencies by √2 / (2π cut-off)
        self.filter_delay_s = float(np.sqrt(2) / (2 * np.pi * settings.cutoff_hz))
        self.tracker = MarkerTracker(body, markers.labels)
        step_s, forces = 1 / markers.rate_hz, 12 * len(self.ground.variants)
        self.motion = RealtimeFilter(settings.cutoff_hz, N_Q, step_s)
        self.forces = RealtimeFilter(settings.cutoff_hz, forces, step_s)
        in_real_time = settings.model_copy(update={"filter": "realtime"})
        self.support = Support(body, [plate.corners for plate in plates], in_real_time)
        self.settling_s, _ = settling_s(laboratory.filters(in_real_time))
        ready = kernels(lanes=ONE_FRAME)
        self.segment_poses = OneFrameKernel(ready.segment_poses, body.geometry)
        self.newton_euler = OneFrameKernel(ready.newton_euler, body.geometry, body.inertia_vector)
        self.pelvis = np.array([body.segment_of[m] == "pelvis" for m in self.tracker.markers])
        self.zeros: EmptyPlates | None = None
        if live.follow_zeros:
            if self.ground.platform is not None:
                raise ValueError(
                    "[live] follow_zeros: the zeros of a platform that moves are unseen"
                )
            rate_hz = markers.rate_hz
            self.zeros = EmptyPlates(body.marker_set, markers.labels, plates, rate_hz)
        self.shown: Mask = np.zeros(len(TREE), bool)
        self.pelvis_seen_s = self.known_s = self.known_since_s = -np.inf
        self.foot_on = np.full(len(plates), -1)
        self.waiting = deque[_Pose]()
        self.newest_s = -np.inf
        self.solved = self.marked = 0

    @property
    def received(self) -> int:
        """Frames that were received."""
        return len(self.waiting) + self.solved + self.marked

    def push(self, samples: Samples) -> list[LiveFrame]:
        """Take what arrived of one stream, in order; those that are not used are ignored.

        Gives the frames that are now complete, or that have waited too long, in order.
        """
        started = perf_counter()
        if samples.stream == self.stream.name:
            self._take_frames(samples)
        else:
            self.analog.append(samples)
        frames = []
        while self.waiting and (complete := self._complete(self.waiting[0].time)) is not None:
            frames.append(self._next(complete, started))
            started = perf_counter()
        return frames

    def finish(self) -> list[LiveFrame]:
        """Give the frames that still wait for samples, as late ones."""
        return [self._next(False, perf_counter()) for _ in range(len(self.waiting))]

    def _take_frames(self, samples: Samples) -> None:
        positions = samples.values.reshape(len(samples.time), len(self.stream.labels), 3)
        # a marker of which one coordinate is missing is not seen
        if (gaps := np.asarray(np.isnan(positions).any(axis=2))).any():
            positions = np.where(gaps[..., None], np.nan, positions)
        for time, position in zip(samples.time.tolist(), positions, strict=True):
            self.newest_s = time
            self.waiting.append(self._pose(time, position))

    def _complete(self, time: float) -> bool | None:
        """Whether all samples of a frame are there; None where they may still come."""
        needed_s = time + self.wait_s - ROUNDING_S
        newest = [buffer.newest_s for buffer in self.analog.used.values()]
        if min(newest, default=np.inf) >= needed_s:
            return True
        now_s = max(self.newest_s, *newest)
        # ten seconds at 100 Hz: more come at once only from a file, and wait for nothing
        if now_s > needed_s + self.live.wait_s or len(self.waiting) > 1000:
            return False
        return None

    def _pose(self, time: float, position: Array) -> _Pose:
        """Solve a frame's markers, (M, 3) [m]."""
        solution = self.tracker.step(time, position)
        self.motion.step(time, solution.q)
        q = self.motion.value
        # generalized forces and residual of the motion alone: plates are subtracted once they come
        tau, wrench, motion = self.newton_euler(q, self.motion.velocity, self.motion.acceleration)
        # pressure is compared with unfiltered feet, since plates are not filtered yet either
        feet, places = self._places(solution.q)[1:], self._places(q)
        platform, above = self.ground.seen(position), None
        if platform is not None or self.ground.platform is None:  # else it waits for its commands
            above = self.support.feet(np.array([time]), places[None], _one(platform))
        middles = (feet[:2] + feet[2:]) / 2  # between ankle and ball
        # what a wrench under each foot does to the coordinates of the legs
        on_legs = (motion.reshape(N_Q, 1, 6)[LEGS] * MOVES).reshape(len(LEGS), 12)
        needed = tau.copy(), wrench.copy(), on_legs.T, skew(q[:3])
        shown = needed, solution.marker_error, self._quality_of_pose(time, solution)
        return _Pose(time, position, platform, q, middles, places, above, *shown)

    def _places(self, q: Array) -> Array:
        """Give pelvis, ankles and balls, left before right, coordinates (46,) to (5, 3) [m]."""
        (poses,) = self.segment_poses(q)
        return np.asarray(poses[OF_PLACES])

    def _quality_of_pose(self, time: float, solution: FrameSolution) -> Quality:
        """Say what markers do not show in a frame."""
        quality = Quality(0)
        if self.tracker.left_out.any():
            quality |= Quality.MARKERS_LEFT_OUT
        if self.tracker.frozen:
            quality |= Quality.MARKERS_FROZEN
        if not solution.converged:
            return quality | Quality.POSE_UNKNOWN
        # only what markers have shown before can be lost: a set may have none on a segment
        self.shown |= solution.observed
        pelvis = bool(np.isfinite(solution.marker_error[self.pelvis]).any())
        if (self.shown & ~solution.observed & OF_LEGS).any() or not pelvis:
            quality |= Quality.LIMB_UNSEEN
        if pelvis:
            self.pelvis_seen_s = time
        elif time - self.pelvis_seen_s >= CHECKS.longest_unseen_pelvis:
            quality |= Quality.POSE_UNKNOWN
        return quality

    def _next(self, complete: bool, started: float) -> LiveFrame:
        """Compute the frame that has waited longest; its last sample arrived when it started."""
        pose = self.waiting.popleft()
        time, quality = pose.time, pose.quality
        if self.zeros is not None and (phase := self.zeros.step(time, pose.position)) is not None:
            self.ground.follow(*phase)
        wrenches, platform = self.ground.at(time, pose.platform)
        # the last variant is the most corrected one: it decides which foot is on which plate
        on, uncertain = self._feet_on_plates(wrenches[-1], pose.feet)
        raw = by_foot(wrenches, on)
        unknown = np.asarray(np.isnan(wrenches).any(axis=(1, 2)))
        raw[unknown] = np.nan
        contact = raw[-1, :, 2] > self.settings.contact_threshold_n
        if np.isnan(pose.q[0]):
            raw[:] = np.nan  # what is lost for the motion is lost for the forces
        self.forces.step(time, raw.ravel())

        loads = self.forces.value.reshape(raw.shape)
        alone, wrench, on_legs, to_hip = pose.needed
        # tau = tau of the motion - Jᵀ f of the feet, of each variant
        tau = alone + np.zeros((len(loads), 1))
        tau[:, LEGS] -= loads.reshape(-1, 12) @ on_legs
        # what the motion needs less what the plates give, moved from the lab's origin to mid-hip
        residual = wrench - loads.sum(axis=1)
        residual[:, 3:] += residual[:, :3] @ to_hip

        quality |= Quality.LATE * (not complete) | Quality.FOOT_UNCERTAIN * uncertain
        if platform is not None and np.isnan(platform[1][0]):
            quality |= Quality.PLATFORM_UNKNOWN
        elif unknown[-1]:
            quality |= Quality.FORCES_UNKNOWN
        at, measured = _one(platform), loads[-1, :, 2].sum(keepdims=True)
        above = pose.above or self.support.feet(np.array([time]), pose.places[None], at)
        of_frame = wrenches[-1:], on[None], wrench[2:3], measured
        if not self.support.carried(above, *of_frame, at)[0]:
            quality |= Quality.NOT_CARRIED
        if not self._settled(time, bool(np.isfinite(residual).all()), quality):
            quality |= Quality.SETTLING
        self.solved += quality.counts
        self.marked += not quality.counts

        numbers = tau, reported(residual), loads
        of_variants = (dict(zip(self.ground.variants, array, strict=True)) for array in numbers)
        taus, residuals, by_feet = of_variants
        rest = contact, pose.marker_error, quality, perf_counter() - started, pose.position
        return LiveFrame(time, pose.q, taus, residuals, by_feet, *rest, platform)

    def _feet_on_plates(self, wrenches: Array, feet: Array) -> tuple[Indices, bool]:
        """Give the foot of each plate, 0 left and 1 right, (P,), and whether one is uncertain.

        Wrenches of the plates, (P, 6) [N, N·m], and middles of the feet, (2, 3) [m], are in the
        lab. A plate whose pressure does not decide keeps the foot that it carried last.
        """
        pressure = pressure_beside(wrenches, feet[None], self.settings.contact_threshold_n)
        self.foot_on = np.where(pressure.decided, pressure.nearer, self.foot_on)
        on = np.where(self.foot_on < 0, pressure.nearer, self.foot_on)
        return on, bool(pressure.uncertain.any())

    def _settled(self, time: float, is_known: bool, quality: Quality) -> bool:
        """Whether the filters have settled in a frame, of which pose and forces are known or not.

        They go on over a few frames that are not, but not over a limb that keeps its pose.
        """
        if quality & Quality.LIMB_UNSEEN:
            self.known_s = -np.inf
        elif is_known:
            # after a longer gap the filters have begun anew
            if time - self.known_s > self.motion.longest_s:
                self.known_since_s = time
            self.known_s = time
        return self.known_s > -np.inf and time - self.known_since_s >= self.settling_s - ROUNDING_S


def _one(platform: Pose | None) -> Pose | None:
    """Give a platform's pose with an axis of frames."""
    return None if platform is None else (platform[0][None], platform[1][None])


def stated_streams(
    live: Live, streams: Sequence[StreamDescription]
) -> tuple[StreamDescription, list[StreamDescription]]:
    """Give the streams that are stated, or all: that of the markers, and the analog ones."""
    received = {stream.name: stream for stream in streams}
    markers = [live.markers] if live.markers else [s.name for s in streams if s.kind == "markers"]
    analog = live.analog or [stream.name for stream in streams if stream.kind == "analog"]
    if missing := [name for name in (*markers, *analog) if name not in received]:
        raise ValueError(
            f"[live] names the streams {', '.join(missing)}, which are not received; received: "
            f"{listed(received)}"
        )
    if len(markers) != 1:
        raise ValueError(
            f"one stream of markers is needed, got {listed(markers)}; name it: markers in [live]"
        )
    for name, kind in ((markers[0], "markers"), *((name, "analog") for name in analog)):
        if received[name].kind != kind or not received[name].rate_hz > 0:
            raise ValueError(
                f"[live]: stream {name} must be one of {kind} with a nominal rate, got "
                f"{received[name].kind} at {received[name].rate_hz:g} Hz"
            )
    return received[markers[0]], [received[name] for name in analog]
