"""From samples that arrive to residuals, frame by frame: nothing waits for what comes later."""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from time import perf_counter
from typing import Final

import numpy as np

from hbm.coordinates import LAST_Q, LIMBS, MOVING, N_Q, TREE, support
from hbm.ik.frame_tracking import FrameSolution
from hbm.kernels.kernel import OneFrameKernel
from hbm.kernels.native import kernels
from hbm.model import Body
from hbm.plausibility.outliers import MarkerTracker
from hbm.signals.filtering import RealtimeFilter
from hbm.spatial import Array, Mask, shift_wrench
from hbm.spelling import listed
from pipeline.config.live import Live
from pipeline.config.schema import Settings
from pipeline.io.recording import Plate
from pipeline.live.frames.channels import AnalogStreams, SampleBuffer
from pipeline.live.frames.ground import LiveGround
from pipeline.live.stream import Samples, StreamDescription
from pipeline.trial.gait.carried import PLACES, Feet, Support
from pipeline.trial.gait.contact import FEET
from pipeline.trial.gait.pressure import pressure_beside
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.motion_check import LEGS, MAX_UNSEEN_PELVIS_S
from pipeline.trial.quality import Quality, settling_s
from pipeline.trial.residuals import reported


def _none() -> Array:
    return np.empty((0, 3))


@dataclass(frozen=True, slots=True)
class LiveFrame:
    """One frame.

    Attributes
    ----------
    number
        Of the frame among those received, from 0.
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

    number: int
    time: float
    q: Array
    tau: Mapping[str, Array]
    residual: Mapping[str, Array]
    by_foot: Mapping[str, Array]
    contact: Mask
    marker_error: Array
    quality: Quality
    computing_s: float
    markers: Array = field(default_factory=_none)
    platform: tuple[Array, Array] | None = None

    @property
    def rms_marker_error_m(self) -> float:
        """Root mean square of the marker errors; NaN where there are none [m]."""
        seen = self.marker_error[np.isfinite(self.marker_error)]
        return float(np.sqrt(np.mean(seen**2))) if len(seen) else float("nan")


OF_PLACES = [MOVING.index(segment) for segment in PLACES]


class LiveDynamics:
    """The equations of motion of one body.

    Parameters
    ----------
    body
        The subject.
    """

    def __init__(self, body: Body) -> None:
        ready = kernels()
        self.segment_poses = OneFrameKernel(ready.segment_poses, body.geometry)
        self.newton_euler = OneFrameKernel(ready.newton_euler, body.geometry, body.inertia_vector)
        self.chains = [np.array(support(LAST_Q[foot])) for foot in FEET]

    def feet(self, q: Array) -> Array:
        """Give the middle of the left and the right foot, ankle to toes, (2, 3) [m].

        Parameters
        ----------
        q
            Coordinates, (46,) [m and rad].
        """
        ankles_and_balls = self.places(q)[1:]
        return np.asarray((ankles_and_balls[:2] + ankles_and_balls[2:]) / 2)

    def places(self, q: Array) -> Array:
        """Give pelvis, ankles and balls, left before right, coordinates (46,) to (5, 3) [m]."""
        (poses,) = self.segment_poses(q)
        return np.asarray(poses.reshape(len(MOVING), 4, 3)[OF_PLACES, 3])

    def needed(self, q: Array, v: Array, a: Array) -> tuple[Array, Array, Array]:
        """Give what a motion needs where nothing but gravity acts, as `hbm.engines`.

        Returns
        -------
        tau
            Generalized forces, (46,) [N, N·m].
        wrench
            On the pelvis, lab axes about the lab origin, (6,) [N, N·m].
        motion
            Of each coordinate per unit rate, (46, 6).
        """
        tau, wrench, motion = self.newton_euler(q, v, a)
        return tau.copy(), wrench.copy(), motion.reshape(N_Q, 6).copy()

    def under(
        self, needed: tuple[Array, Array, Array], by_foot: Array, pelvis: Array
    ) -> tuple[Array, Array]:
        """Give generalized forces and residuals with wrenches on the feet, of V variants.

        Parameters
        ----------
        needed
            As `needed` gives it.
        by_foot
            On the left and the right foot, lab axes about the lab origin, (V, 2, 6) [N, N·m].
        pelvis
            Mid-hip in the lab, (3,) [m].

        Returns
        -------
        tau, residual
            (V, 46) and (V, 6) [N, N·m].
        """
        alone, wrench, motion = needed
        tau = np.tile(alone, (len(by_foot), 1))
        for foot, chain in enumerate(self.chains):
            tau[:, chain] -= by_foot[:, foot] @ motion[chain].T
        return tau, shift_wrench(wrench - by_foot.sum(axis=1), pelvis)


class LiveFeet:
    """The foot that each plate carried last.

    Parameters
    ----------
    plates
        How many there are.
    threshold_n
        Vertical force above which a plate is loaded [N].
    """

    def __init__(self, plates: int, threshold_n: float) -> None:
        self.threshold_n = threshold_n
        self.last: list[int | None] = [None] * plates

    def on_plates(self, wrenches: Array, feet: Array) -> tuple[Array, bool]:
        """Give the foot of each plate, 0 left and 1 right, (P,), and whether one is uncertain.

        Parameters
        ----------
        wrenches
            Of the plates, lab axes about the lab origin, (P, 6) [N, N·m].
        feet
            Middle of the left and the right foot in the lab, (2, 3) [m].
        """
        on = np.empty(len(wrenches), int)
        count = len(wrenches)
        pressure = pressure_beside(wrenches, np.broadcast_to(feet, (count, 2, 3)), self.threshold_n)
        for k in range(count):
            if pressure.decided[k]:
                self.last[k] = int(pressure.nearer[k])
            last = self.last[k]
            on[k] = pressure.nearer[k] if last is None else last
        return on, bool(pressure.uncertain.any())


class LiveValidity:
    """What was unknown when, frame by frame.

    Parameters
    ----------
    body
        The subject.
    markers
        Names of the markers that are solved from, (K,).
    settling_s
        How long the filters need after a gap [s].
    longest_s
        Longest step between frames that is no gap for the filters [s].
    """

    def __init__(
        self, body: Body, markers: Sequence[str], settling_s: float, longest_s: float
    ) -> None:
        segment_of = body.segment_of
        self.of_pelvis = np.array([segment_of[name] == "pelvis" for name in markers])
        parts = {part for leg in LEGS for part in LIMBS[leg]}
        self.of_legs = np.array([c.segment in parts for c in TREE])
        self.shown: Mask = np.zeros(len(TREE), bool)
        self.settling_s, self.longest_s = settling_s, longest_s
        self.time = -np.inf
        self.known_since: float | None = None
        self.pelvis_seen_s = -np.inf

    def of_pose(self, time: float, solution: FrameSolution) -> Quality:
        """Say what markers do not show in a frame."""
        if not solution.converged:
            return Quality.POSE_UNKNOWN
        found = Quality(0)
        self.shown |= solution.observed
        pelvis = bool(np.isfinite(solution.marker_error[self.of_pelvis]).any())
        if (self.shown & ~solution.observed & self.of_legs).any() or not pelvis:
            found |= Quality.LIMB_UNSEEN
        if pelvis:
            self.pelvis_seen_s = time
        elif time - self.pelvis_seen_s >= MAX_UNSEEN_PELVIS_S:
            found |= Quality.POSE_UNKNOWN
        return found

    def settled(self, time: float, gap: bool) -> bool:
        """Whether the filters have settled in a frame, which is a gap of pose or forces or none."""
        since_s, self.time = time - self.time, time
        if gap:
            self.known_since = None
            return False
        if self.known_since is None or since_s > self.longest_s:
            self.known_since = time
        return time - self.known_since >= self.settling_s


ROUNDING_S: Final = 1e-6
"""Of time stamps; what lies so near the end of a reach has no weight."""
MAX_WAITING_FRAMES: Final = 1000
"""Ten seconds at 100 Hz; more come at once only from a file, and wait for nothing."""


@dataclass(frozen=True, slots=True)
class Counts:
    """Frames and samples that a chain received.

    Attributes
    ----------
    received, solved, marked
        Frames: all, those that count, those that do not. Those that wait for samples are neither.
    late
        Marked frames whose samples did not arrive in time.
    doubled, out_of_order
        Samples of all streams that were left out since one as late, or later, was there already.
    """

    received: int
    solved: int
    marked: int
    late: int
    doubled: int
    out_of_order: int


@dataclass(frozen=True, slots=True)
class _Pose:
    """What the markers of a frame show: all that needs no analog sample."""

    time: float
    position: Array
    platform: tuple[Array, Array] | None
    q: Array
    feet: Array
    places: Array
    above: Feet | None
    needed: tuple[Array, Array, Array]
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
    >>> from pipeline.virtual_lab.protocol.stationary_trial import simulate_trial
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
        markers, analog = _described(live, streams)
        self.body, self.settings, self.live, self.stream = body, settings, live, markers
        self.analog = AnalogStreams(analog)
        self.ground = LiveGround(
            laboratory,
            settings,
            plates,
            [live.channels_of(plate.number) for plate in plates],
            self.analog,
            markers.labels,
            markers.rate_hz,
        )
        self.wait_s = max(0.0, *self.ground.ahead_s)
        self.filter_delay_s = float(np.sqrt(2) / (2 * np.pi * settings.cutoff_hz))
        self.tracker = MarkerTracker(body, markers.labels)
        self.feet = LiveFeet(len(plates), settings.contact_threshold_n)
        self.dynamics = LiveDynamics(body)
        corners, cutoff_hz = [plate.corners for plate in plates], settings.cutoff_hz
        self.support = Support(body, corners, settings.contact_threshold_n, cutoff_hz, "realtime")
        in_real_time = settings.model_copy(update={"filter": "realtime"})
        after_s, _ = settling_s(laboratory.filters(in_real_time))
        self.motion = RealtimeFilter(settings.cutoff_hz, N_Q)
        self.validity = LiveValidity(body, self.tracker.markers, after_s, self.motion.longest_s)
        self.forces = RealtimeFilter(settings.cutoff_hz, 12 * len(self.ground.variants))
        self.waiting = deque[_Pose]()
        self.order = SampleBuffer(0, MAX_WAITING_FRAMES)
        self.received = self.solved = self.marked = self.late = 0

    @property
    def counts(self) -> Counts:
        """What was received so far."""
        buffers = [self.order, *self.analog.used.values()]
        return Counts(
            self.received,
            self.solved,
            self.marked,
            self.late,
            sum(buffer.doubled for buffer in buffers),
            sum(buffer.out_of_order for buffer in buffers),
        )

    def push(self, samples: Samples) -> list[LiveFrame]:
        """Take what arrived of one stream.

        Parameters
        ----------
        samples
            Of one of the streams; those of others are ignored.

        Returns
        -------
        list of LiveFrame
            Frames that are now complete, or that have waited too long, in order.
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
        values = samples.values.reshape(len(samples.time), -1, 3)
        values = np.where(np.isnan(values).any(axis=2, keepdims=True), np.nan, values)
        kept = self.order.append(samples.time, np.empty((len(values), 0)))
        for time, position in zip(samples.time[kept].tolist(), values[kept], strict=True):
            self.waiting.append(self._pose(time, position))
        self.received = len(self.waiting) + self.solved + self.marked

    def _complete(self, time: float) -> bool | None:
        """Whether all samples of a frame are there; None where they may still come."""
        needed_s = time + self.wait_s - ROUNDING_S
        newest = [buffer.newest_s for buffer in self.analog.used.values()]
        if min(newest, default=np.inf) >= needed_s:
            return True
        now_s = max(self.order.newest_s, *newest)
        if now_s > needed_s + self.live.wait_s or len(self.waiting) > MAX_WAITING_FRAMES:
            return False
        return None

    def _pose(self, time: float, position: Array) -> _Pose:
        """Solve a frame's markers, (M, 3) [m]."""
        solution = self.tracker.step(time, position)
        self.motion.step(time, solution.q)
        q, v, a = self.motion.value, self.motion.velocity, self.motion.acceleration
        quality = self.validity.of_pose(time, solution)
        if self.tracker.left_out.any():
            quality |= Quality.MARKERS_LEFT_OUT
        if self.tracker.frozen:
            quality |= Quality.MARKERS_FROZEN
        feet, needed = self.dynamics.feet(solution.q), self.dynamics.needed(q, v, a)
        places, platform = self.dynamics.places(q), self.ground.seen(position)
        above = None
        if platform is not None or self.ground.platform is None:
            above = self.support.feet(np.array([time]), places[None], _of_one_frame(platform))
        error = solution.marker_error
        return _Pose(time, position, platform, q, feet, places, above, needed, error, quality)

    def _next(self, complete: bool, started: float) -> LiveFrame:
        """Compute the frame that has waited longest; its last sample arrived when it started."""
        pose = self.waiting.popleft()
        time, quality = pose.time, pose.quality
        ground = self.ground.at(time, pose.platform)
        best = ground.wrenches[-1]
        on, uncertain = self.feet.on_plates(best, pose.feet)
        raw = _by_foot(ground.wrenches, on)
        self.forces.step(time, raw.ravel())

        by_foot = self.forces.value.reshape(raw.shape)
        tau, residual = self.dynamics.under(pose.needed, by_foot, pose.q[:3])
        if not complete:
            quality |= Quality.LATE
        if not ground.platform_known:
            quality |= Quality.PLATFORM_UNKNOWN
        elif np.isnan(best).any():
            quality |= Quality.FORCES_UNKNOWN
        platform = _of_one_frame(ground.platform)
        above = pose.above or self.support.feet(np.array([time]), pose.places[None], platform)
        need, measured = pose.needed[1][2:3], by_foot[-1, :, 2].sum(keepdims=True)
        if not self.support.carried(above, best[None], on[None], need, measured, platform)[0]:
            quality |= Quality.NOT_CARRIED
        if uncertain:
            quality |= Quality.FOOT_UNCERTAIN
        gap = bool(np.isnan(residual).any() or quality & Quality.LIMB_UNSEEN)
        if not self.validity.settled(time, gap):
            quality |= Quality.SETTLING
        self.solved += quality.counts
        self.marked += not quality.counts
        self.late += not complete
        names = self.ground.variants
        return LiveFrame(
            number=self.solved + self.marked - 1,
            time=time,
            q=pose.q,
            tau=dict(zip(names, tau, strict=True)),
            residual=dict(zip(names, reported(residual), strict=True)),
            by_foot=dict(zip(names, by_foot, strict=True)),
            contact=raw[-1, :, 2] > self.settings.contact_threshold_n,
            marker_error=pose.marker_error,
            quality=quality,
            computing_s=perf_counter() - started,
            markers=pose.position,
            platform=ground.platform,
        )


def _of_one_frame(pose: tuple[Array, Array] | None) -> tuple[Array, Array] | None:
    """Give the pose of a platform with an axis of frames."""
    return None if pose is None else (pose[0][None], pose[1][None])


def _by_foot(wrenches: Array, on: Array) -> Array:
    """Add up the wrenches of the plates, (V, P, 6), under each foot, (V, 2, 6).

    NaN where a plate of a variant is unknown.
    """
    by_foot = (on == np.array([[0], [1]])).astype(float) @ wrenches
    by_foot[np.isnan(wrenches).any(axis=(1, 2))] = np.nan
    return np.asarray(by_foot)


def _described(
    live: Live, streams: Sequence[StreamDescription]
) -> tuple[StreamDescription, list[StreamDescription]]:
    """Give the streams that are stated, or all: that of the markers, and the analog ones."""
    received = {stream.name: stream for stream in streams}
    of_kind = {
        kind: [stream.name for stream in streams if stream.kind == kind]
        for kind in ("markers", "analog")
    }
    markers = [live.markers] if live.markers else of_kind["markers"]
    analog = list(live.analog or of_kind["analog"])
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
