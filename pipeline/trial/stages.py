"""The stages between ground and results: pose, loads under the feet, quality, delay of the plates.

`pipeline.trial.chain` passes a trial through them. Live frames pass the same functions one at a
time: `by_foot` (`pipeline.trial.gait.contact`) takes the plates of one frame, (P, 6), as it takes
those of a trial, (T, P, 6), and `in_lab` (`pipeline.trial.ground.platform`) any number of frames.
What a frame needs of the frames before it is in small objects with a method for the next one:
`hbm.plausibility.outliers.MarkerTracker` and `hbm.signals.filtering.RealtimeFilter` for pose and
forces, and `pipeline.trial.gait.carried.Support` for the quality.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from compensation import marker_plate_delay
from hbm.body import Body
from hbm.dynamics import Dynamics, filter_motion, inverse_dynamics_variants
from hbm.markers import Markers
from hbm.motion import Motion
from hbm.numbers import read_numbers
from hbm.signals.filtering import acceleration_lag_s, longest_gap_s, low_pass, over_short_gaps
from hbm.signals.samples import without_short_gaps
from hbm.spatial import Array, Indices, Mask
from pipeline.config.schema import PlateContact, Settings
from pipeline.trial.checks import OF_LEGS, known_frames, shown_frames
from pipeline.trial.gait.carried import Support, places_of
from pipeline.trial.gait.contact import (
    FEET,
    SharedPlates,
    both_stand,
    by_foot,
    feet_of,
    share_between_feet,
)
from pipeline.trial.ground.wrenches import Ground
from pipeline.trial.quality import NO_SUPPORT, Quality, flagged, free_of, settled_frames

LIMITS: Final = read_numbers("pipeline.trial", "thresholds.toml", "stages")


class Pose(NamedTuple):
    """The markers that were solved, the motion that they show, and the filtered one, T frames.

    Over a few lost frames both motions are interpolated.
    """

    markers: Markers
    solved: Motion
    motion: Motion


def filtered_pose(markers: Markers, solved: Motion, settings: Settings) -> Pose:
    """Filter the motion that markers show."""
    motion = filter_motion(solved, cutoff=settings.cutoff_hz, method=settings.filter)
    whole = over_short_gaps(solved.q, solved.time, settings.cutoff_hz, settings.filter)
    return Pose(markers, replace(solved, q=whole), motion)


class Loads(NamedTuple):
    """The plates under the feet, and the dynamics that follow.

    Attributes
    ----------
    places
        Of the feet and the pelvis before the filter, as `places_of` gives them, (T, 5, 3) [m].
    shared
        Whose foot each plate carries.
    wrenches
        Variant -> foot -> filtered wrench, lab axes about the lab origin, (T, 6) [N, N·m].
    dynamics
        Variant -> forces and residual.
    need, measured
        Vertical force that the motion needs, and that of all plates in the best variant, filtered,
        (T,) [N].
    """

    places: Array
    shared: SharedPlates
    wrenches: dict[str, dict[str, Array]]
    dynamics: dict[str, Dynamics]
    need: Array
    measured: Array


def dynamics_under_feet(
    body: Body,
    pose: Pose,
    ground: Ground,
    settings: Settings,
    contacts: Sequence[PlateContact] = (),
    jobs: int = 1,
) -> Loads:
    """Give every plate to the foot on it, and compute the dynamics of each variant.

    Errors are those of `share_between_feet` and `hbm.dynamics.inverse_dynamics`.
    """
    # feet are found by the unfiltered pose: the plates are not filtered yet either
    motion, places = pose.motion, places_of(body, pose.solved.q)
    shared = share_between_feet(
        motion.time,
        ground.variants[ground.best],
        feet_of(places),
        settings.contact_threshold_n,
        standing=both_stand(places, motion.time),
        numbers=[plate.number for plate in ground.plates],
        by_hand=contacts,
        method=settings.filter,
    )
    # each plate goes to one foot, then each foot passes the filter of the motion
    wrenches = {
        variant: _filtered(by_foot(np.stack(of_plates, axis=1), shared.on), pose.solved, settings)
        for variant, of_plates in ground.variants.items()
    }
    of_variants = inverse_dynamics_variants(body, motion, [*wrenches.values()], jobs=jobs)
    dynamics = dict(zip(wrenches, of_variants, strict=True))
    measured = np.sum([*wrenches[ground.best].values()], axis=0)[:, 2]
    # the residual is what the motion needs beyond the plates
    need = measured + dynamics[ground.best].residual[:, 2]
    return Loads(places, shared, wrenches, dynamics, need, measured)


def _filtered(feet: Array, solved: Motion, settings: Settings) -> dict[str, Array]:
    """Pass the wrenches under both feet, (T, 2, 6), through the filter of the motion.

    In real time a gap of one foot is one of both: who carries a plate that is unknown is unknown.
    A frame without a pose is one too: a frame that was lost is lost for the plates.
    """
    if settings.filter == "realtime":
        unknown = np.isnan(feet).any(axis=(1, 2)) | ~solved.converged
        feet = np.where(unknown[:, None, None], np.nan, feet)
    filtered = low_pass(feet, solved.time, settings.cutoff_hz, settings.filter)
    return {foot: filtered[:, k] for k, foot in enumerate(FEET)}


def frame_quality(
    body: Body,
    pose: Pose,
    ground: Ground,
    loads: Loads,
    unloaded: Sequence[Array | None],
    settings: Settings,
    settling: tuple[float, float],
) -> Indices:
    """Give the flags of every frame, (T,), with the time that filters need to settle [s]."""
    motion = pose.motion
    # a leg that no marker shows keeps its last pose, and jumps when it is seen again
    is_known, held = known_frames(body, motion), ~shown_frames(body, pose.solved)
    held &= motion.converged
    computed = [np.isfinite(one.residual).all(axis=1) for one in loads.dynamics.values()]
    computed = np.all([is_known, ground.known, *computed], axis=0)
    # gaps that are shorter than this are bridged, and the filters go on over them
    longest_s = longest_gap_s(settings.cutoff_hz)
    gapless = without_short_gaps(computed, motion.time, longest_s) & ~held
    lost = ~motion.converged & without_short_gaps(motion.converged, motion.time, longest_s)
    return flagged(
        {
            Quality.POSE_UNKNOWN: ~is_known & ~lost,
            Quality.LIMB_UNSEEN: held,
            Quality.FORCES_UNKNOWN: ~ground.known,
            Quality.NOT_CARRIED: ~_carried(body, motion, ground, loads, unloaded, settings),
            Quality.SETTLING: ~settled_frames(gapless, motion.time, settling),
            Quality.FOOT_UNCERTAIN: _foot_uncertain(ground, loads, settings, motion.time),
            Quality.BRIDGED: lost,
        }
    )


def _foot_uncertain(ground: Ground, loads: Loads, settings: Settings, time: Array) -> Mask:
    """Find the frames in which the filtered force of a leg holds one of an uncertain foot, (T,).

    In real time those that are uncertain themselves.
    """
    ambiguous = loads.shared.ambiguous
    if settings.filter == "realtime" or not ambiguous.any():
        return np.asarray(ambiguous.any(axis=1))
    # the filter spreads the force of an uncertain foot into frames that are certain
    vertical = np.nan_to_num(np.stack(ground.variants[ground.best], axis=1)[..., 2])
    uncertain_n = np.where(ambiguous, np.abs(vertical), 0.0).sum(axis=1)
    filtered = low_pass(uncertain_n, time, settings.cutoff_hz, settings.filter)
    return np.asarray(filtered > LIMITS.largest_uncertain)


def _carried(
    body: Body,
    motion: Motion,
    ground: Ground,
    loads: Loads,
    unloaded: Sequence[Array | None],
    settings: Settings,
) -> Mask:
    """Find the frames in which the plates carry the subject, (T,), by `Support`.

    What plates read at rest does not count, but in real time.
    """
    best, at_rest = ground.variants[ground.best], None
    if settings.filter != "realtime":
        at_rest = np.array([0.0 if zero is None else zero[2] for zero in unloaded])
    support = Support(body, [plate.corners for plate in ground.plates], settings, at_rest)
    platform = None if ground.pose is None else (ground.pose.rotation, ground.pose.position)
    feet = support.feet(motion.time, places_of(body, motion.q), platform)
    of_plates = np.stack(best, axis=1), loads.shared.on, loads.need, loads.measured
    return support.carried(feet, *of_plates, platform)


def known_forces(dynamics: Mapping[str, Dynamics], quality: Indices) -> dict[str, Dynamics]:
    """Leave out the forces of legs whose load is unknown, and all while filters settle."""
    # moments of the trunk do not depend on whose foot a plate carries
    known_load = free_of(quality, NO_SUPPORT | Quality.FOOT_UNCERTAIN)[:, None]
    unknown = (~known_load & OF_LEGS) | ~free_of(quality, Quality.SETTLING)[:, None]
    return {variant: one.without_forces(unknown) for variant, one in dynamics.items()}


class PlateDelay(NamedTuple):
    """How much later a trial's plates are than its markers.

    Attributes
    ----------
    seconds, uncertainty_s
        The delay, and half of its 95 % interval; NaN where it is not determined.
    why_unknown
        Why it is not; empty where it is.
    """

    seconds: float
    uncertainty_s: float
    why_unknown: str = ""


def plate_delay(loads: Loads, best: str, counts: Mask, settings: Settings) -> PlateDelay:
    """Estimate how much later a trial's plates are than its markers, from its inverse dynamics.

    Residual and plates' forces together are what the motion needs, which the real-time filter makes
    later than the plates' forces.
    """
    dynamics = loads.dynamics[best]
    # horizontal and vertical forces of both feet, and what the motion needs of them
    force = np.sum([*loads.wrenches[best].values()], axis=0)[:, :3]
    need = force + np.where(counts[:, None], dynamics.residual[:, :3], np.nan)
    try:
        late = marker_plate_delay(force, need, dynamics.time)
    except ValueError as error:
        return PlateDelay(np.nan, np.nan, str(error))
    # the real-time filter makes accelerations later than forces by this
    lag_s = acceleration_lag_s(dynamics.time) if settings.filter == "realtime" else 0.0
    return PlateDelay(late.seconds + lag_s, late.uncertainty)
