"""Files of a study, read as the study states it."""

from compensation import BeltModel, Calibration
from pipeline.config.schema import Trial
from pipeline.config.study import Study
from pipeline.io.read import read_recording
from pipeline.io.recording import Recording
from pipeline.trial.ground.belts import read_belts
from pipeline.trial.ground.calibration_recording import read_calibration
from pipeline.trial.ground.laboratory import Laboratory


def read_study_file(study: Study, name: str, trial: Trial | None = None) -> Recording:
    """Read a recording of a study, with the axes and labels that the study states.

    Parameters
    ----------
    study
        The study.
    name
        The file.
    trial
        The trial whose file it is, for the forces or the record beside it.

    Returns
    -------
    Recording
        As `read_recording` gives it, with its errors.
    """
    trial = trial or Trial()
    return read_recording(
        study.path(name),
        study.file.axes,
        study.path(trial.forces) if trial.forces else None,
        record=study.path(trial.record) if trial.record else None,
        rename=study.file.rename,
    )


def read_study_laboratory(study: Study) -> Laboratory:
    """Read a study's treadmill with its calibrations, as far as they are stated.

    Raises
    ------
    ValueError, OSError
        If a calibration cannot be read or fitted.
    """
    treadmill, axes = study.file.treadmill, study.file.axes
    calibration: Calibration | None = None
    belts: tuple[BeltModel, ...] = ()
    if treadmill.calibration:
        calibration = read_calibration(study.path(treadmill.calibration), treadmill, axes)
    if treadmill.belt is not None:
        belts = read_belts(study.path(treadmill.belt.calibration), treadmill.belt, axes)
    return Laboratory(treadmill, calibration, belts)
