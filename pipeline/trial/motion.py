"""A trial's motion from its markers, looking at the whole trial or as while it is measured."""

from hbm.body import Body
from hbm.markers import Markers
from hbm.motion import Motion
from hbm.notes import Note
from hbm.plausibility.marker_tracking import track_motion
from hbm.plausibility.outliers import solve_without_outliers
from hbm.plausibility.repeated_positions import without_frozen_frames
from hbm.signals.filtering import Method


def solve_motion(
    body: Body, markers: Markers, method: Method, jobs: int
) -> tuple[Markers, Motion, tuple[Note, ...]]:
    """Find the coordinates of a trial, without marker positions that cannot be.

    Parameters
    ----------
    body
        The subject.
    markers
        Trajectories, T frames.
    method
        Of the filter that follows; with "realtime" no frame depends on a later one.
    jobs
        Threads; one in real time.

    Returns
    -------
    markers
        The same with gaps in place of positions that were left out.
    motion
        Of these, unfiltered.
    notes
        What was left out.
    """
    if method == "realtime":
        return track_motion(body, markers)
    return solve_without_outliers(body, without_frozen_frames(markers, body.markers), jobs)
