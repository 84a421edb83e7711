"""The ground of a recording, and the notes on it, in one call."""

from pipeline.config.schema import Platform, Treadmill
from pipeline.trial.ground.laboratory import bind
from pipeline.trial.ground.wrenches import ground_wrenches
from tests.pipeline import lab

ON_MARKERS = Platform(markers=tuple(lab.PLATFORM_MARKERS_M))
TREADMILL = Treadmill(accelerometers=lab.CHANNELS, platform=ON_MARKERS)


def ground_of(recording, laboratory, time=None, plate_delay_s=0.0, **low_pass):
    """The wrenches of the plates at the markers' times, or at others."""
    time = recording.markers.time if time is None else time
    return ground_wrenches(bind(recording, laboratory, plate_delay_s), time, **low_pass)


def notes_on(recording, laboratory, time=None, plate_delay_s=0.0):
    """The notes on the wrenches of the plates."""
    return ground_of(recording, laboratory, time, plate_delay_s).notes
