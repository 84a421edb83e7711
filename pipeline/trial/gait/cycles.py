"""Gait cycles: which there are, which a condition asks for, and signals over 0–100 %."""

from collections.abc import Iterable, Sequence
from itertools import product
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from compensation.platform import PlatformPose
from hbm.notes import Note
from hbm.numbers import read_numbers
from hbm.signals.filtering import low_pass
from hbm.signals.resampling import interpolate
from hbm.signals.samples import stretches
from hbm.spatial import Array, Indices, Mask
from pipeline.config.schema import Condition, Unit
from pipeline.io.recording import Event, Recording
from pipeline.trial.gait.events import LIMITS as EVENTS
from pipeline.trial.gait.events import OTHER_SIDE, SIDES, event_times
from pipeline.trial.ground.accelerometers import read_channel
from pipeline.trial.quality import NO_SUPPORT, Quality, free_of

LIMITS: Final = read_numbers("pipeline.trial", "thresholds.toml", "cycles")


def perturbation_onsets(
    recording: Recording, condition: Condition, platform: PlatformPose | None
) -> Array:
    """Find the perturbations of a trial: from the pulse channel, else from the platform's motion.

    Parameters
    ----------
    recording
        The trial.
    condition
        Names the pulse channel, if there is one.
    platform
        The platform's pose at the markers' times.

    Returns
    -------
    Array
        Onsets, (P,) [s].

    Raises
    ------
    ValueError
        If there is neither a pulse channel nor a pose, or no perturbation.
    """
    name, channel = recording.source.name, condition.pulse_channel
    if channel is not None:
        onsets, source = pulse_onsets(recording, channel), channel
    elif platform is not None:
        onsets, source = motion_onsets(recording.markers.time, platform), "the platform's motion"
    else:
        raise ValueError(
            f"{name}: a perturbed condition needs a pulse_channel, or the platform's pose"
        )
    if not len(onsets):
        raise ValueError(f"{name}: {source} shows no perturbation, but the condition is perturbed")
    return onsets


def pulse_onsets(recording: Recording, channel: str) -> Array:
    """Find perturbation onsets in a pulse channel, at the channel's own rate.

    Parameters
    ----------
    recording
        The trial.
    channel
        Name of the analog channel that rises when a perturbation starts.

    Returns
    -------
    Array
        Onsets, (P,) [s]: where the signal first leaves its median, up or down, by half of the
        largest excursion; what follows within a second belongs to the same pulse. Empty where the
        signal never pulses.

    Raises
    ------
    ValueError
        If the channel is not there.
    """
    time, signal = read_channel(recording, channel, lambda unit: 1.0)
    # from the level at which the channel mostly is, up or down
    excursion = np.abs(signal - float(np.nanmedian(signal)))
    peak = float(np.nanmax(excursion, initial=0.0))
    noise = float(np.nanmedian(excursion))
    if peak <= LIMITS.pulse_to_noise * noise or peak == 0:
        return np.empty(0)
    return _onsets(time, excursion > peak / 2)


def motion_onsets(time: Array, platform: PlatformPose) -> Array:
    """Find perturbation onsets from the platform's pose.

    Parameters
    ----------
    time
        (T,) [s].
    platform
        Its pose, (T,) frames.

    Returns
    -------
    Array
        Where a corner of its surface first moves faster than 0.1 m/s, (P,) [s]: some 0.05 s after
        the platform starts to move 5 cm at 0.3 m/s. A slow return does not count.
    """
    return _onsets(time, _moves_fast(time, platform))


def motion_stops(onsets: Array, time: Array, platform: PlatformPose) -> Array:
    """Find until when the platform moves fast after each perturbation.

    Parameters
    ----------
    onsets
        Perturbation onsets, (P,) [s].
    time
        (T,) [s].
    platform
        Its pose, (T,) frames.

    Returns
    -------
    Array
        First frame after the onset, and after the motion has begun, in which no corner of its
        surface moves faster than 0.1 m/s, (P,) [s]; NaN where none does within a second of the
        onset. A slow return does not count.

    Examples
    --------
    >>> time = np.arange(1000) / 100
    >>> position = np.outer(0.3 * np.clip(time - 2.0, 0, 1 / 6), [0, 1, 0])
    >>> platform = PlatformPose(np.tile(np.eye(3), (1000, 1, 1)), position)
    >>> [f"{stop:.2f}" for stop in motion_stops(np.array([2.0, 6.0]), time, platform)]
    ['2.18', 'nan']
    """
    # stretches of fast motion; the one that lasts at the onset, or begins soon after it
    moving = stretches(_moves_fast(time, platform))
    begins, ends = time[moving[:, 0]], np.append(time, time[-1])[moving[:, 1]]
    onset = onsets[:, None]
    after = np.where((ends > onset) & (begins < onset + LIMITS.shortest_interval), ends, np.nan)
    return np.asarray(np.fmin.reduce(after, axis=1, initial=np.nan))


def _moves_fast(time: Array, platform: PlatformPose) -> Mask:
    """Give whether any corner of the platform's surface moves fast, (T,); straight over gaps."""
    rate_hz, fast = 1 / np.median(np.diff(time)), np.zeros(len(time), bool)
    is_known = np.isfinite(platform.position[:, 0])
    if not is_known.any():
        return fast
    # about the corners of a treadmill's surface, in the platform's frame: where a rotation shows
    for x, y in product((-0.8, 0.8), (-0.5, 0.5)):
        place = platform.to_lab((x, y, 0.0))
        # the low-pass needs a path without gaps
        bridged = np.column_stack(
            [np.interp(time, time[is_known], axis) for axis in place[is_known].T]
        )
        path = low_pass(bridged, rate_hz, LIMITS.motion_cutoff, "zero_phase")
        speed = np.linalg.norm(np.gradient(path, time, axis=0), axis=1)
        fast |= speed > LIMITS.platform_speed
    return fast


def _onsets(time: Array, high: Mask) -> Array:
    """Give when a signal becomes high, the first of times that follow one another closely."""
    # where the signal rises; what follows closely belongs to the same perturbation
    begins = time[1:][high[1:] & ~high[:-1]]
    return np.asarray(begins[np.diff(begins, prepend=-np.inf) > LIMITS.shortest_interval])


NOT_ALTERNATING: Final = "events that do not alternate"
NO_SWING: Final = "feet that do not leave the ground"


def gait_cycles(events: Sequence[Event], side: str) -> tuple[Array, tuple[str, ...]]:
    """Cut a trial into gait cycles, from foot strike to foot strike of one side.

    Parameters
    ----------
    events
        Gait events.
    side
        "left" or "right".

    Returns
    -------
    spans
        Start and stop of each plausible cycle, half-open, (C, 2) [s].
    left_out
        Why each other cycle was left out: a duration outside 0.6 to 1.5 medians, or events that do
        not alternate (the foot does not leave the ground once, or the other foot does not strike
        once), judged where the trial has events of that kind at all.
    """
    # half-open: the strike at the end belongs to the next cycle
    strikes = event_times(events, "foot_strike", side)
    spans = np.column_stack([strikes[:-1], strikes[1:]])
    alternate = np.ones(len(spans), bool)
    for kind in (("foot_off", side), ("foot_strike", OTHER_SIDE[side])):
        times = event_times(events, *kind)
        # how many events of this kind lie within each cycle: one in walking
        within = np.searchsorted(times, spans[:, 1]) - np.searchsorted(times, spans[:, 0], "right")
        alternate &= (within == 1) | (not len(times))
    return _of_usual_duration(spans, alternate)


def steps(
    events: Sequence[Event], side: str, unit: Literal["step", "stance"]
) -> tuple[Array, tuple[str, ...]]:
    """Cut a trial into steps of one side, to the other foot's strike, or stances, to its foot off.

    Parameters
    ----------
    events
        Gait events.
    side
        Of the foot whose strike begins them.
    unit
        "step" or "stance".

    Returns
    -------
    spans, left_out
        As of `gait_cycles`; one within which that foot strikes again does not alternate.

    Examples
    --------
    >>> strikes = [Event(0.5, "foot_strike", "left"), Event(1.1, "foot_strike", "right")]
    >>> steps(strikes, "left", "step")[0].tolist(), len(steps(strikes, "right", "step")[0])
    ([[0.5, 1.1]], 0)
    """
    starts = event_times(events, "foot_strike", side)
    last = ("foot_strike", OTHER_SIDE[side]) if unit == "step" else ("foot_off", side)
    ends = event_times(events, *last)
    # the first end after each start
    following = np.searchsorted(ends, starts, "right")
    ended = following < len(ends)
    spans = np.column_stack([starts[ended], ends[following[ended]]])
    # the foot must not strike again before
    alternate = spans[:, 1] < np.append(starts[1:], np.inf)[ended]
    kept, left_out = _of_usual_duration(spans[alternate], np.ones(alternate.sum(), bool))
    return kept, (*left_out, *(NOT_ALTERNATING,) * np.count_nonzero(~alternate))


def _of_usual_duration(spans: Array, alternate: Mask) -> tuple[Array, tuple[str, ...]]:
    """Keep the spans, (C, 2), whose events alternate and whose duration is near the median."""
    duration = np.diff(spans, axis=1)[:, 0]
    # of the trial itself, since speeds and people differ
    typical = np.median(duration) if len(duration) else np.nan
    usual = (duration >= LIMITS.shortest_duration * typical) & (
        duration <= LIMITS.longest_duration * typical
    )
    far, wrong = np.count_nonzero(~usual), np.count_nonzero(usual & ~alternate)
    return spans[usual & alternate], ("a duration far from the median",) * far + (
        NOT_ALTERNATING,
    ) * wrong


def cut_cycles(
    events: Sequence[Event],
    time: Array,
    quality: Indices,
    min_valid_share: float,
    unit: Unit = "cycle",
    feet: Array | None = None,
) -> tuple[dict[str, Array], dict[str, tuple[str, ...]]]:
    """Cut gait cycles, steps or stances of both sides; leave out those of which too little counts.

    Parameters
    ----------
    events
        Gait events.
    time
        (T,) [s].
    quality
        Flags of every frame, (T,).
    min_valid_share
        Of a cycle's frames that count: with less the cycle is left out.
    unit
        What the trial is cut into.
    feet
        Where the feet are from the pelvis, of `feet_from_pelvis`: without a swing there is none.

    Returns
    -------
    cycles
        Side -> start and stop of each cycle, (C, 2) [s].
    left_out
        Side -> why each other cycle was left out.
    """
    cycles: dict[str, Array] = {}
    left_out: dict[str, tuple[str, ...]] = {}
    for side in SIDES:
        cut = gait_cycles(events, side) if unit == "cycle" else steps(events, side, unit)
        spans, reasons = cut[0], list[str]()
        for start, stop in spans:
            inside = slice(*np.searchsorted(time, (start, stop)))
            reason = shortage(quality[inside], min_valid_share)
            if feet is not None and is_standing(feet[inside]):
                reason = NO_SWING
            if start < time[0] or stop > time[-1]:
                reason = "an end beyond the recorded markers"
            reasons.append(reason)
        cycles[side] = spans[np.array(reasons, str) == ""]
        left_out[side] = (*cut[1], *filter(None, reasons))
    return cycles, left_out


def is_standing(feet: Array) -> bool:
    """Tell by where the feet are from the pelvis, (N, 2, 3) [m], that none of them swings.

    Where a foot is unknown it may have swung.

    Examples
    --------
    >>> sway = np.zeros((100, 2, 3)) + 0.01 * np.sin(np.arange(100))[:, None, None]
    >>> is_standing(sway)
    True
    """
    # path of each foot against the pelvis over the cycle, NaN where a foot is unknown
    extent = np.ptp(feet, axis=0) if len(feet) else np.full((2, 3), np.nan)
    return bool((np.linalg.norm(extent, axis=1) < EVENTS.least_swing).all())


def shortage(quality: Indices, min_valid_share: float) -> str:
    """Say why a cycle is left out, by the flags of its frames, (N,); nothing where it is not."""
    if not free_of(quality, Quality.POSE_UNKNOWN).all():
        return "frames without a solution or without forces"
    if np.count_nonzero(free_of(quality, NO_SUPPORT)) < min_valid_share * len(quality):
        return "plates that do not carry the subject"
    if np.count_nonzero(free_of(quality)) < min_valid_share * max(len(quality), 1):
        return "an end or a gap too near for the filters to settle"
    return ""


def found_cycles(events: Sequence[Event], sides: Iterable[str]) -> int:
    """Count the gait cycles that the foot strikes of some sides show, whether they can be used."""
    strikes = (event_times(events, "foot_strike", side).size for side in sides)
    return sum(max(count - 1, 0) for count in strikes)


def normalise(time: ArrayLike, values: ArrayLike, cycles: ArrayLike, samples: int = 101) -> Array:
    """Bring signals to 0–100 % of each gait cycle by cubic splines.

    Parameters
    ----------
    time
        Sample times, (T,) [s], increasing.
    values
        Signals, (T, ...).
    cycles
        Start and stop of each cycle, (C, 2) [s].
    samples
        Samples per cycle, both ends included.

    Returns
    -------
    Array
        Signals over the cycles, (C, samples, ...); NaN in gaps and outside the recorded time.

    Raises
    ------
    ValueError
        If the signals do not fit the times.
    """
    start, stop = np.asarray(cycles, float).reshape(-1, 2).T[..., None]
    return interpolate(time, values, start + (stop - start) * np.linspace(0, 1, samples))


def mean_and_sd(curves: Array) -> tuple[Array, Array]:
    """Give mean and SD over cycles, (C, samples, ...) to (samples, ...), of what is known of each.

    NaN where no cycle is known; the SD where only one is.
    """
    # each instant over the cycles in which it is known
    values = np.ma.masked_invalid(curves)
    mean, sd = (np.ma.filled(x, np.nan) for x in (values.mean(axis=0), values.std(axis=0, ddof=1)))
    return np.asarray(mean), np.asarray(sd)


COUNTED_SIDE: Final = "right"
"""Cycles of walking are counted by one foot, as in the thesis; both feet's cycles overlap. Where it
has none, those of the other foot count."""


def select_cycles(
    cycles: dict[str, Array], condition: Condition, onsets: Array
) -> tuple[dict[str, Array], tuple[Note, ...]]:
    """Select the gait cycles of a condition.

    Parameters
    ----------
    cycles
        Side -> start and stop of each cycle, (C, 2) [s].
    condition
        How many, from when (cycles or perturbations before ``skip_s`` do not count), and whether
        only perturbed ones.
    onsets
        Perturbation onsets, (P,) [s].

    Returns
    -------
    selected
        Side -> cycles. Walking counts cycles of the right foot, or of the left one if the right has
        none, the first ones there are. A
        perturbation counts the cycle whose initial contact came last before it, of either foot;
        two perturbations within one cycle count it once.
    notes
        ``cycles_of_left`` and what is missing: ``cycles_missing``, ``perturbation_without_cycle``.
    """
    notes: tuple[Note, ...] = ()
    if condition.perturbed:
        selected, without = _perturbed(cycles, onsets[onsets >= condition.skip_s])
        if len(without):
            named = [f"{onset:.2f} s" for onset in without]
            notes = (Note.of("perturbation_without_cycle", onsets=named),)
    else:
        later = {side: spans[spans[:, 0] >= condition.skip_s] for side, spans in cycles.items()}
        counted = COUNTED_SIDE, *SIDES
        side = next((foot for foot in counted if len(later[foot])), COUNTED_SIDE)
        selected = {side: later[side]}
        if side != COUNTED_SIDE:
            notes = (Note.of("cycles_of_left"),)
    count, starts = condition.cycles, np.sort(np.concatenate([*selected.values()])[:, 0])
    if count is None:
        return selected, notes
    if len(starts) < count:
        return selected, (*notes, Note.of("cycles_missing", found=len(starts), wanted=count))
    last = starts[count - 1]
    return {side: spans[spans[:, 0] <= last] for side, spans in selected.items()}, notes


def _perturbed(cycles: dict[str, Array], onsets: Array) -> tuple[dict[str, Array], Array]:
    """Give the cycles that contain a perturbation, and the onsets that none contains."""
    every, sizes = np.concatenate([*cycles.values()]), [len(spans) for spans in cycles.values()]
    chosen, without = np.zeros(len(every), bool), []
    for onset in onsets:
        # cycles of both feet overlap: the one that began last
        containing = np.flatnonzero((every[:, 0] <= onset) & (onset < every[:, 1]))
        if len(containing):
            chosen[containing[np.argmax(every[containing, 0])]] = True
        else:
            without.append(onset)
    of_sides = zip(cycles.items(), np.split(chosen, np.cumsum(sizes)[:-1]), strict=True)
    return {side: spans[chosen] for (side, spans), chosen in of_sides}, np.array(without)
