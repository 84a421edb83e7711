"""A subject's body from what is stated, recorded and known of it."""

from collections.abc import Mapping
from pathlib import Path

from hbm.anatomy import HipRule
from hbm.body import Body, build_body
from hbm.functional import functional_hips
from hbm.markers import MarkerSet, marker_sets
from hbm.overrides import SegmentOverride, read_overrides
from hbm.spatial import Array
from pipeline.recording import Recording
from pipeline.stated import Settings, Subject
from pipeline.weighing import joint_widths, stature


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
        As `build_body` and `functional_hips`, or if functional hips have no recording, or a
        recording for them is of no use.
    """
    named = marker_sets().get(settings.marker_set or "")
    knee, ankle = joint_widths(subject, pose)
    hip: HipRule | dict[str, Array]
    if settings.hip != "functional":
        if hip_trial is not None:
            raise ValueError('a recording for functional hips is of no use without "functional"')
        hip = settings.hip
    elif hip_trial is None:
        raise ValueError("functional hips need a recording in which the thighs swing (hip_trial)")
    else:
        hip = functional_hips(hip_trial.markers, marker_set or named)
    return build_body(
        pose.markers,
        mass=mass,
        sex=subject.sex,
        height_m=stature(subject, pose),
        marker_set=marker_set or settings.marker_set,
        window_s=window_s,
        hip=hip,
        marker_offset_m=settings.marker_offset_m,
        knee_width_m=knee,
        ankle_width_m=ankle,
        overrides=segments,
    )


def read_segments(path: Path) -> dict[str, SegmentOverride]:
    """Read what is known of single segments from a TOML file; raises as `read_overrides`."""
    return read_overrides(path.read_text(encoding="utf-8-sig"), path.name)
