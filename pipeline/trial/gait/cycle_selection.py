"""Select the gait cycles that count: the first ones of walking, or the perturbed ones."""

from collections.abc import Mapping
from typing import Final

import numpy as np

from compensation.platform.pose import PlatformPose
from hbm.notes import Note
from hbm.signals.filtering import low_pass
from hbm.spatial import Array
from pipeline.config.schema import Condition
from pipeline.io.recording import Recording

COUNTED_SIDE: Final = "right"
"""Cycles of walking are counted by one foot, as in the thesis; both feet's cycles overlap. Where it
has none, those of the other foot count."""
MIN_ONSET_INTERVAL_S: Final = 1.0
"""What follows sooner belongs to the same perturbation; perturbations are strides apart."""
MIN_SWAY_SPEED_MPS: Final = 0.1
"""A third of the perturbation's 0.3 m/s; the slow return stays below."""
SWAY_CUTOFF_HZ: Final = 6.0
"""Low-pass on the platform's position before its speed is taken."""
MIN_PULSE_TO_NOISE: Final = 10.0
"""Largest by median excursion: a channel that never pulses has only noise."""


def select_cycles(
    cycles: dict[str, Array], condition: Condition, onsets: Array | None
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
        Perturbation onsets, (P,) [s]; needed where the condition is perturbed.

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
        onsets = np.empty(0) if onsets is None else onsets
        selected, notes = _perturbed(cycles, onsets[onsets >= condition.skip_s])
    else:
        later = {side: spans[spans[:, 0] >= condition.skip_s] for side, spans in cycles.items()}
        side = counted_side({side: len(spans) for side, spans in later.items()})
        selected = {side: later[side]}
        if side != COUNTED_SIDE:
            notes = (Note.of("cycles_of_left"),)
    found = sum(len(spans) for spans in selected.values())
    wanted = condition.cycles
    if wanted is None:
        return selected, notes
    if found < wanted:
        notes = (*notes, Note.of("cycles_missing", found=found, wanted=wanted))
    return _first(selected, wanted), notes


def counted_side(cycles: Mapping[str, int]) -> str:
    """Give the foot by which walking is counted, from how many cycles each foot has."""
    return COUNTED_SIDE if cycles[COUNTED_SIDE] else max(cycles, key=lambda side: cycles[side])


def _perturbed(
    cycles: dict[str, Array], onsets: Array
) -> tuple[dict[str, Array], tuple[Note, ...]]:
    selected: dict[str, list[Array]] = {side: [] for side in cycles}
    notes = []
    for onset in onsets:
        containing = [
            (span[0], side, span)
            for side, spans in cycles.items()
            for span in spans
            if span[0] <= onset < span[1]
        ]
        if containing:
            _, side, span = max(containing, key=lambda cycle: cycle[0])
            selected[side].append(span)
        else:
            notes.append(Note.of("perturbation_without_cycle", onset_s=onset))
    spans = {
        side: np.unique(np.reshape(found, (-1, 2)), axis=0) for side, found in selected.items()
    }
    return spans, tuple(notes)


def _first(cycles: dict[str, Array], count: int) -> dict[str, Array]:
    """Keep the earliest cycles of both sides together."""
    starts = np.sort(np.concatenate([spans[:, 0] for spans in cycles.values()]))
    if len(starts) <= count:
        return cycles
    last = starts[count - 1]
    return {side: spans[spans[:, 0] <= last] for side, spans in cycles.items()}


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
    name = recording.source.name
    if condition.pulse_channel is not None:
        onsets, source = pulse_onsets(recording, condition.pulse_channel), condition.pulse_channel
    elif platform is not None:
        onsets = sway_onsets(recording.markers.time, platform.position[:, 1])
        source = "the platform's motion"
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
    if recording.analog is None:
        raise ValueError(f"{recording.source.name}: no analog channels, so no {channel!r}")
    try:
        signal = recording.analog.channel(channel)
    except KeyError as error:
        raise ValueError(f"{recording.source.name}: {error.args[0]}") from error
    excursion = np.abs(signal - float(np.nanmedian(signal)))
    peak = float(np.nanmax(excursion, initial=0.0))
    noise = float(np.nanmedian(excursion))
    if peak <= MIN_PULSE_TO_NOISE * noise or peak == 0:
        return np.empty(0)
    high = excursion > peak / 2
    return _first_of_each(recording.analog.time[1:][high[1:] & ~high[:-1]])


def sway_onsets(time: Array, lateral: Array) -> Array:
    """Find perturbation onsets from the platform's lateral position.

    Parameters
    ----------
    time
        (T,) [s].
    lateral
        Lateral position of the platform, (T,) [m].

    Returns
    -------
    Array
        Where its speed, low-passed at 6 Hz, first exceeds 0.1 m/s, (P,) [s]: some 0.05 s after the
        platform starts to move 5 cm at 0.3 m/s. A slow return does not count.
    """
    filtered = low_pass(lateral, 1 / np.median(np.diff(time)), SWAY_CUTOFF_HZ, "zero_phase")
    fast = np.abs(np.gradient(filtered, time)) > MIN_SWAY_SPEED_MPS
    return _first_of_each(time[1:][fast[1:] & ~fast[:-1]])


def _first_of_each(times: Array) -> Array:
    """Keep the first of times that follow one another closely."""
    return times[np.diff(times, prepend=-np.inf) > MIN_ONSET_INTERVAL_S]
