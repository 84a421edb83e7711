"""Check of a trial's markers: labels of the wrong marker, and positions that were not measured."""

from hbm.body import Body
from hbm.notes import Note
from hbm.plausibility.exchanged_labels import labels_exchanged
from hbm.plausibility.exchanged_sides import sides_exchanged
from hbm.plausibility.marker_distances import changed_distances
from hbm.plausibility.repeated_positions import repeated_positions
from pipeline.io.recording import Recording


def check_markers(body: Body, trial: Recording, pose: Recording) -> tuple[Note, ...]:
    """Find wrong labels in a trial or its calibration pose, and positions that were held.

    Parameters
    ----------
    body
        The subject.
    trial, pose
        The trial, and the recording of the calibration pose; they may be the same.

    Returns
    -------
    tuple of Note
        ``sides_exchanged``, ``labels_exchanged``, ``marker_distances_changed``,
        ``markers_frozen`` and ``markers_constant``, where there are any.
    """
    notes = list(sides_exchanged(body, trial.markers, trial.source.name))
    if pose is not trial:
        notes += sides_exchanged(body, pose.markers, pose.source.name)
    return (
        *notes,
        *labels_exchanged(trial.markers, body.markers),
        *changed_distances(body, trial.markers),
        *repeated_positions(body, trial.markers),
    )
