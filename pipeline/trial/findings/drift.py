"""A zero that drifts: what a plate reads over time while no foot is on it.

The motion of the feet tells when: while one foot swings and the other one stands, or both stand, no
foot is on a plate over which the middle of no standing foot is. Forces only confirm it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
import scipy

from hbm.markers import Markers, MarkerSet
from hbm.notes import Note
from hbm.numbers import read_numbers
from hbm.signals.filtering import Method
from hbm.spatial import Array, Mask
from pipeline.io.read_options import parse_mending
from pipeline.io.recording import Plate, Recording
from pipeline.trial.findings.evidence import LIMITS as EVIDENCE
from pipeline.trial.findings.zeros import LIMITS as ZEROS
from pipeline.trial.gait.carried import plate_edges
from pipeline.trial.gait.events import SIDES
from pipeline.trial.ground.laboratory import Laboratory, bind
from pipeline.trial.ground.platform import platform_pose
from pipeline.trial.ground.wrenches import plate_artefacts
from pipeline.trial.subject import common_tenths, tenths

LIMITS: Final = read_numbers("pipeline.trial", "thresholds.toml", "drift")

UNKNOWN: Final = -1
"""Whether a foot swings: feet are not seen."""
MIN_VARIANCE: Final = 1e-9
"""Of a plate whose unloaded samples are exactly zero [N², (N·m)²]."""


Phase = tuple[float, float, Mask]
"""Its first and its last frame [s], and which plates no foot is on, (P,)."""


class EmptyPlates:
    """Finds the phases in which no foot is on a plate, of a trial or frame by frame.

    Parameters
    ----------
    marker_set
        Of the subject.
    names
        Labels of the markers.
    plates
        Where they are; one whose place is unknown may always carry a foot.
    rate_hz
        Of the markers.
    """

    def __init__(
        self,
        marker_set: MarkerSet,
        names: Sequence[str],
        plates: Sequence[Plate],
        rate_hz: float,
    ) -> None:
        segment_of = marker_set.present(names).segment
        self.columns = [
            [k for k, name in enumerate(names) if segment_of.get(name) in of_foot]
            for of_foot in ((f"{side}_foot", f"{side}_toes") for side in SIDES)
        ]
        self.inward, self.begins = plate_edges(np.array([plate.corners for plate in plates]))
        # frames of the phase that lasts, and whether a foot swings in it
        self.time, self.position, self.swings = list[float](), list[Array](), UNKNOWN
        self.most = max(LIMITS.fewest_frames, round(LIMITS.longest_phase * rate_hz))

    def phases(self, markers: Markers) -> Iterator[Phase]:
        """Give the phases of a trial in order."""
        time, position = markers.time, markers.position
        # one more frame ends the last phase
        frames = zip(time.tolist(), position, self._swings(time, position), strict=True)
        for frame in (*frames, (np.inf, position[0], UNKNOWN)):
            if (ended := self._next(*frame)) is not None:
                yield ended

    def step(self, time: float, position: Array) -> Phase | None:
        """Take the next frame, markers (M, 3) [m]; gives the phase that ended before it, if any."""
        two = [*zip(self.time[-1:], self.position[-1:], strict=True), (time, position)]
        times, positions = (np.array(of_frames) for of_frames in zip(*two, strict=True))
        return self._next(time, position, self._swings(times, positions)[-1])

    def _next(self, time: float, position: Array, swings: int) -> Phase | None:
        """Take a frame in which a foot swings or not; gives the phase that ended before it."""
        ended = None
        # a phase lasts while the feet do the same, and is cut where it is long
        if swings != self.swings or len(self.time) == self.most:
            if self.swings != UNKNOWN and len(self.time) >= LIMITS.fewest_frames:
                empty = self._empty(np.array(self.time), np.array(self.position))
                ended = (self.time[0], self.time[-1], empty) if empty.any() else None
            self.time, self.position, self.swings = [], [], swings
        self.time.append(time)
        self.position.append(position)
        return ended

    def _swings(self, time: Array, position: Array) -> list[int]:
        """Say in which frames a foot swings, 1, or both stand, 0, (T,)."""
        velocity = [self._velocity(time, position, foot) for foot in (0, 1)]
        visible = [np.isfinite(foot).all(axis=2).sum(axis=1) > 1 for foot in velocity]
        # while both stand, part of each is at rest against the other, wherever the ground moves
        apart = np.linalg.norm(velocity[0][:, :, None] - velocity[1][:, None], axis=-1)
        # of all pairs of markers, the two that move most alike
        slowest = np.fmin.reduce(apart, axis=(1, 2), initial=np.inf)
        swings = np.where(np.all(visible, axis=0), slowest > LIMITS.swing_speed, UNKNOWN)
        return [UNKNOWN, *swings.tolist()]

    def _empty(self, time: Array, position: Array) -> Mask:
        """Say which plates no foot is on in frames in which one swings, or both stand, (P,)."""
        middles = list[Array]()
        for foot, columns in enumerate(self.columns):
            # one that stands goes with the ground, whose speed hardly changes
            changes = np.std(self._velocity(time, position, foot), axis=0).sum(axis=-1)
            if not self.swings or not np.fmin.reduce(changes) > EVIDENCE.standing_spread:
                middles.append(np.nanmean(position[:, columns], axis=1))
        if not middles:
            return np.zeros(len(self.begins), bool)
        # how far each foot is within each edge of each plate, horizontally [m]
        depth = np.vecdot(np.array(middles)[..., None, None, :2], self.inward) - self.begins
        # a foot is over a plate that it is within all four edges of
        over = (depth > 0).all(axis=-1)
        return np.asarray(~over.any(axis=(0, 1)) & np.isfinite(self.begins).all(axis=1))

    def _velocity(self, time: Array, position: Array, foot: int) -> Array:
        """Give that of the markers of a foot from frame to frame, (T - 1, M, 3) [m/s]."""
        of_foot = position[:, self.columns[foot]]
        return np.asarray(np.diff(of_foot, axis=0) / np.diff(time)[:, None, None])


def reading(time: Array, wrench: Array, up: Array, start_s: float, stop_s: float) -> Array | None:
    """Give what a plate reads in a phase in which no foot is on it, (6,).

    Of its samples, (N,) [s] and (N, 6), whose third axis is the direction ``up``. None where the
    phase is too short, or the vertical force changes as it does under a load.
    """
    # without the ends of the phase, in which a foot leaves or lands
    part = slice(*np.searchsorted(time, (start_s + LIMITS.edges[0], stop_s - LIMITS.edges[1])))
    time, wrench = time[part], wrench[part]
    begin_s, count = common_tenths(time) if len(time) > 1 else (start_s, 0)
    if count < LIMITS.fewest_tenths:
        return None
    # a load changes from tenth to tenth of a second, a zero does not
    vertical = tenths(wrench[:, :3] @ up, time, begin_s, count)
    mean = wrench.mean(axis=0)
    return mean if np.ptp(vertical) <= ZEROS.spread and np.isfinite(mean).all() else None


class Course(NamedTuple):
    """A natural spline through what one component read in phases.

    Attributes
    ----------
    knots, coefficients
        Times, and its coefficients in `_basis`, (K,): one is a constant, two are a line.
    change, interval
        From where it is lowest to where it is highest, later minus earlier, and half of its 95 %
        interval.
    sure
        Whether it changes beyond the interval of 99.9 %.
    """

    knots: Array
    coefficients: Array
    change: float
    interval: float
    sure: bool

    @classmethod
    def through(cls, time: Array, values: Array) -> "Course":
        """Fit it to readings, (N,), with as many knots as they call for."""
        count = len(time)
        # three readings more than knots tell the error; with few readings, a constant
        most = max(min(LIMITS.most_knots, count - 3), 1)
        fits = list[tuple[Array, Array, Array, Array]]()
        for number in range(1, most + 1):
            knots = np.linspace(time[0], time[-1], number)
            basis = _basis(knots, time)
            coefficients = np.asarray(np.linalg.lstsq(basis, values)[0])
            fits.append((knots, basis, coefficients, values - basis @ coefficients))
        # neighbours that leave a line alike, by vibration in step with gait, are fewer readings
        alike = _alike(fits[min(1, most - 1)][-1])
        independent = max(count / alike, LIMITS.fewest_independent)
        # Schwarz's criterion: a knot has to explain more than it adds freedom
        scores = [
            independent * np.log(np.mean(rest**2) + MIN_VARIANCE) + len(knots) * np.log(independent)
            for knots, _, _, rest in fits
        ]
        knots, basis, coefficients, rest = fits[int(np.argmin(scores))]
        # variance of one reading, by what the spline leaves of them, and larger as they go together
        free = max(count - len(knots), 1)
        variance = np.sum(rest**2) / free * alike
        fitted = basis @ coefficients
        # where the spline is lowest and highest at a reading, in order of time
        first, last = sorted((int(np.argmin(fitted)), int(np.argmax(fitted))))
        between = basis[last] - basis[first]
        # standard error of that difference, by the covariance of least squares
        error = np.sqrt(variance * between @ np.linalg.pinv(basis.T @ basis) @ between)
        # the largest of all differences, after Scheffé
        directions = max(len(knots) - 1, 1)
        quantiles = scipy.special.fdtri(directions, free, (0.95, LIMITS.confidence))
        interval, surely = (error * np.sqrt(directions * quantiles)).tolist()
        change = float(fitted[last] - fitted[first])
        return cls(knots, coefficients, change, interval, sure=abs(change) > surely)


def _alike(rest: Array) -> float:
    """Give how many neighbours err as one, by the correlation of one with the next."""
    # lag-one autocorrelation of what is left
    correlation = np.sum(rest[1:] * rest[:-1]) / (np.sum(rest**2) + MIN_VARIANCE)
    # that of what a line leaves of few readings is too small
    unbiased = correlation + (2 + 4 * correlation) / len(rest)
    bounded = float(np.clip(unbiased, 0.0, LIMITS.most_alike))
    # variance of a mean of autocorrelated readings, by that of independent ones
    return (1 + bounded) / (1 - bounded)


def _basis(knots: Array, times: Array) -> Array:
    """Give natural cubic splines, which are lines beyond the knots, (T, K)."""
    if len(knots) == 1:
        return np.ones((len(times), 1))
    at, x = (knots - knots[0]) / np.ptp(knots), (times - knots[0]) / np.ptp(knots)
    # truncated cubes of time, which is 0 at the first knot and 1 at the last one
    cubes = np.maximum(x[:, None] - at, 0.0) ** 3
    # beyond the last knot cubes and squares vanish (Hastie, Tibshirani and Friedman 2009, eq. 5.5)
    curved = (cubes[:, :-1] - cubes[:, -1:]) / (1 - at[:-1])
    return np.column_stack([np.ones_like(x), x, curved[:, :-1] - curved[:, -1:]])


@dataclass(frozen=True, slots=True, eq=False)
class Zero:
    """What a plate reads over time while no foot is on it, in its own axes about its centre.

    Attributes
    ----------
    time
        End of each of N phases, (N,) [s].
    values
        What it read in them, (N, 6) [N, N·m].
    courses
        Of the six components.
    """

    time: Array
    values: Array
    courses: tuple[Course, ...]

    @classmethod
    def of(cls, plate: Plate, phases: Sequence[tuple[float, float]]) -> "Zero | None":
        """Give that of a plate; None where no phase shows it."""
        time, wrench, up = plate.time, plate.wrench_in_plate, plate.rotation[2]
        # the end of a phase: in real time it is not known before
        of_phases = ((stop, reading(time, wrench, up, start, stop)) for start, stop in phases)
        read = [(stop, values) for stop, values in of_phases if values is not None]
        if not read:
            return None
        ends, values = (np.array(column) for column in zip(*read, strict=True))
        # a plate that somebody else loads for a moment reads the same before and after
        reach = LIMITS.neighbours // 2
        around = np.pad(values, ((reach, reach), (0, 0)), mode="reflect")
        usual = np.median(
            np.lib.stride_tricks.sliding_window_view(around, 2 * reach + 1, 0), axis=-1
        )
        apart = np.abs(values - usual)
        step = np.median(np.abs(np.diff(values, axis=0)), axis=0) if len(values) > 1 else 0.0
        # a force of the usual spread, a third of a metre from the centre
        spread = ZEROS.spread * np.repeat([1.0, 1 / 3], 3)
        kept = (apart <= spread + LIMITS.most_steps * step).all(axis=1)
        courses = (Course.through(ends[kept], component[kept]) for component in values.T)
        return cls(ends, values, tuple(courses))

    @property
    def span_s(self) -> tuple[float, float]:
        """The first and the last phase that a course goes through."""
        knots = max((course.knots for course in self.courses), key=len)
        return float(knots[0]), float(knots[-1])

    @property
    def change(self) -> Array:
        """How much each component changes over that span, (6,) [N, N·m]."""
        return np.array([course.change for course in self.courses])

    @property
    def interval(self) -> Array:
        """Half of the 95 % interval of the change, (6,) [N, N·m]."""
        return np.array([course.interval for course in self.courses])

    @property
    def drifts(self) -> Mask:
        """Which components change by more than their error, and by what matters, (6,)."""
        sure = np.array([course.sure for course in self.courses])
        return np.asarray(sure & (np.abs(self.change) > LIMITS.least_change))

    def at(self, times: Array) -> Array:
        """Give it over time, (T,) to (T, 6); constant where it does not drift."""
        # components that do not drift beyond their error are constants
        zero = np.tile(np.median(self.values, axis=0), (len(times), 1))
        for k in np.flatnonzero(self.drifts):
            course = self.courses[k]
            zero[:, k] = _basis(course.knots, times) @ course.coefficients
        return zero

    def known_at(self, times: Array) -> Array:
        """Give it as it is known in real time, (T,) to (T, 6); nothing before the first phase."""
        zeros = [np.zeros(6), *(latest(self.values[:k]) for k in range(1, len(self.values) + 1))]
        return np.array(zeros)[np.searchsorted(self.time, times)]


def latest(values: Array) -> Array:
    """Give a zero in real time, (6,), by what was read in the phases so far, (N, 6)."""
    return np.asarray(np.median(values[-LIMITS.followed_phases :], axis=0))


def following(recording: Recording) -> set[int]:
    """Give the numbers of the plates whose zero is stated to be followed."""
    mendings = map(parse_mending, recording.options.mend_plates)
    return {number for number, deed, _ in mendings if deed == "drift"}


def zeros_of(
    recording: Recording, marker_set: MarkerSet, laboratory: Laboratory
) -> tuple[Zero | None, ...]:
    """Give the zero of each plate; None where a foot is always on it, or its load is unknown."""
    if (relative := _from_platform(recording, laboratory)) is None:
        return (None,) * len(recording.plates)
    markers = relative.markers
    plates = EmptyPlates(marker_set, markers.names, relative.plates, markers.rate_hz)
    phases = [*plates.phases(markers)]
    return tuple(
        Zero.of(plate, [(start, stop) for start, stop, empty in phases if empty[k]])
        for k, plate in enumerate(relative.plates)
    )


def _from_platform(recording: Recording, laboratory: Laboratory) -> Recording | None:
    """Show markers as the platform sees them, and plates without what it and the belts add."""
    platform, compensated = laboratory.treadmill.platform, laboratory.calibration is not None
    # a moving platform adds its inertia to plates without load: no zero can be seen
    if platform is not None and not compensated:
        return None
    plates, markers = recording.plates, recording.markers
    try:
        pose, _ = platform_pose(recording, platform, markers.time)
        if compensated or laboratory.belts:
            artefacts, _ = plate_artefacts(bind(recording, laboratory, None))
            plates = tuple(
                replace(plate, wrench_in_plate=plate.wrench_in_plate - artefact)
                for plate, artefact in zip(plates, artefacts, strict=True)
            )
    except ValueError:  # a calibration pose may lack what a trial needs, and a trial says so itself
        return None
    if pose is not None:
        # in the frame of the platform, in which plates do not move
        position = (markers.position - pose.position[:, None]) @ pose.rotation
        markers = replace(markers, position=position)
    return replace(recording, markers=markers, plates=plates)


def with_followed_zeros(
    recording: Recording, marker_set: MarkerSet, laboratory: Laboratory, method: Method
) -> Recording:
    """Subtract the zeros that are stated to be followed; notes say of how many phases, or none.

    In real time a zero is known by the phases before.
    """
    zeros = zeros_of(recording, marker_set, laboratory)
    plates, notes = list(recording.plates), list(recording.notes)
    for k, (plate, zero) in enumerate(zip(recording.plates, zeros, strict=True)):
        if plate.number not in following(recording):
            continue
        if zero is None:
            notes.append(Note.of("plate_drift_unseen", plate=plate.number))
            continue
        over_time = (zero.known_at if method == "realtime" else zero.at)(plate.time)
        plates[k] = replace(plate, wrench_in_plate=plate.wrench_in_plate - over_time)
        followed = {"plate": plate.number, "phases": len(zero.time)}
        notes.append(Note.of("plate_zero_followed", **followed))
    return replace(recording, plates=tuple(plates), notes=tuple(notes))
