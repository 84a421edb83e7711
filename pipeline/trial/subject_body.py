"""A subject's body, from what is stated and recorded."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from hbm.body import Body, ImplausibleLegs, build_body
from hbm.calibration_pose.anatomy import HipRule, LimbMeasures
from hbm.calibration_pose.functional import functional_hips
from hbm.coordinates import SIDES
from hbm.markers import MarkerSet, marker_sets
from hbm.notes import Note
from hbm.overrides import SegmentOverride
from hbm.spatial import Array
from pipeline.config.schema import Settings, Subject
from pipeline.io.recording import Recording
from pipeline.io.units import correct_units
from pipeline.trial.weighing import stature

EXPECTED_HIP_DISTANCE_M: Final = 0.03
"""Harrington's regression misses imaged hip centres by 1 to 2 cm in adults: 3 cm is doubtful."""
MAX_HIP_DISTANCE_M: Final = 0.05
"""Beyond this no pelvis explains the difference; the thighs did not swing enough."""


def subject_body(
    pose: Recording,
    subject: Subject,
    settings: Settings,
    mass: float,
    *,
    window_s: tuple[float, float] | None = None,
    marker_set: MarkerSet | None = None,
    hip_trial: Recording | None = None,
    segments: Mapping[str, SegmentOverride] | None = None,
) -> Body:
    """Build a subject's body.

    Parameters
    ----------
    pose
        Recording of the calibration pose.
    subject, settings
        Who, and by which rules.
    mass
        Body mass [kg].
    window_s
        Where the pose is in its recording [s]; by default its quietest second.
    marker_set
        A marker set of one's own; by default the stated one, or recognised from the labels.
    hip_trial
        Recording in which the thighs swing, where ``settings.hip`` is "functional".
    segments
        Segment -> what is known better than the table of inertias.

    Returns
    -------
    Body
        See `hbm.body.build_body`.

    Raises
    ------
    ValueError
        As `build_body` and `functional_hips`; if functional hips have no recording or are too far
        from the regression's, or if there is a recording for them that is not used.
    """
    limbs = limb_measures(subject, pose)

    def built(hip: HipRule | dict[str, Array]) -> Body:
        try:
            return build_body(
                pose.markers,
                mass=mass,
                sex=subject.sex,
                height_m=stature(subject, pose),
                marker_set=marker_set or settings.marker_set,
                window_s=window_s,
                hip=hip,
                limbs=limbs,
                marker_offset_m=settings.marker_offset_m,
                overrides=segments,
            )
        except ImplausibleLegs as error:
            remedy = correct_units(stated=pose.stated.units is not None)
            raise ValueError(f"{pose.source.name}: {error}; {remedy}") from error

    if settings.hip != "functional":
        if hip_trial is not None:
            raise ValueError('a recording for functional hips is not used without "functional"')
        return built(settings.hip)
    if hip_trial is None:
        raise ValueError("functional hips need a recording in which the thighs swing (hip_trial)")
    named = marker_sets().get(settings.marker_set or "")
    body = built(functional_hips(hip_trial.markers, marker_set or named))
    note = _beside_regression(body, built("harrington"), hip_trial.source.name)
    return replace(body, notes=(*body.notes, note))


def limb_measures(subject: Subject, pose: Recording) -> dict[str, LimbMeasures]:
    """Give what was measured on a subject's limbs.

    Parameters
    ----------
    subject
        Who.
    pose
        Recording of the calibration pose.

    Returns
    -------
    dict[str, LimbMeasures]
        Side -> its measures: the recording's own of that side, but widths of knee and ankle that
        are stated.
    """
    limbs = {}
    for side in SIDES:
        recorded = pose.metadata.limbs.get(side, LimbMeasures())
        limbs[side] = replace(
            recorded,
            knee_width_m=subject.knee_width_m or recorded.knee_width_m,
            ankle_width_m=subject.ankle_width_m or recorded.ankle_width_m,
        )
    return limbs


def _beside_regression(body: Body, by_regression: Body, file: str) -> Note:
    """Give how far functional hips are from the regression's; refuse more than pelvises differ."""
    distance_m = {}
    for side in ("right", "left"):
        hip, expected = (
            each.offsets[f"{side}_thigh"] - _pelvis(each) for each in (body, by_regression)
        )
        distance_m[side] = float(np.linalg.norm(hip - expected))
    largest_m = max(distance_m.values())
    if largest_m > MAX_HIP_DISTANCE_M:
        off = ", ".join(f"{side} {1000 * each:.0f} mm" for side, each in distance_m.items())
        raise ValueError(
            f"{file}: the functional hips are {off} from Harrington's regression, more than"
            " pelvises differ: swing both thighs forward, back and sideways by 30° and more"
        )
    code = "functional_hips" if largest_m <= EXPECTED_HIP_DISTANCE_M else "functional_hips_far"
    return Note.of(code, file=file, distance_m=distance_m)


def _pelvis(body: Body) -> Array:
    """Give the middle of the pelvis' markers in its own frame, (3,) [m]."""
    own = [segment == "pelvis" for segment in body.marker_segment]
    return np.asarray(body.marker_position[own].mean(axis=0))
