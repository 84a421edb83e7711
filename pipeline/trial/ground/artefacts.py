"""What a moving treadmill adds to its plates, at the plates' own samples and unfiltered.

The prediction is linear in the accelerations, so that a low-pass that is applied to the difference
afterwards does the same as one on plates and accelerations before: up to the calibration's cut-off
nothing is lost by leaving both unfiltered. What a dynamic model adds was fitted up to that cut-off
only, and is of accelerations that passed it.
"""

from typing import Final

import numpy as np

from compensation import Calibration, InertiaModel, check_trial
from hbm.notes import Note
from hbm.spatial import Array
from pipeline.config.schema import Treadmill
from pipeline.io.recording import Plate, Recording
from pipeline.trial.ground.accelerometers import accelerations, at_plate_times
from pipeline.trial.ground.belts import belt_wrenches
from pipeline.trial.ground.corrected_plates import relative_delays_s
from pipeline.trial.ground.empty_plates import samples_of
from pipeline.trial.ground.instruments import hold_ends
from pipeline.trial.ground.laboratory import Laboratory, plate_models

MIN_NOTED_S: Final = 0.02
"""Two samples of the belts' model, which ends with its last whole interval."""


def plate_artefacts(
    recording: Recording, laboratory: Laboratory
) -> tuple[list[Array], tuple[Note, ...]]:
    """Predict what the platform's motion and accelerating belts add to each plate.

    Parameters
    ----------
    recording
        The trial.
    laboratory
        The treadmill with the calibration of its platform, its belts, or both.

    Returns
    -------
    artefacts
        Per plate at its own samples, in its own moving frame about the centre of its surface,
        (N, 6) [N, N·m]. The accelerations are not low-passed; those of the belts are, as their
        model requires.
    notes
        What is doubtful about calibration and trial, and where a prediction was held.

    Raises
    ------
    ValueError
        The calibration does not fit the trial, a channel is missing, or the prediction is unknown
        within the trial or for more than 0.5 s at one of its ends.
    """
    plates, treadmill = recording.plates, laboratory.treadmill
    artefacts = [np.zeros((len(plate.time), 6)) for plate in plates]
    notes: list[Note] = []
    if laboratory.calibration is not None:
        clock, readings = accelerations(recording, treadmill)
        models = plate_models(recording, laboratory)
        delays_s = relative_delays_s(plates, laboratory.plates)
        for artefact, plate, model, late_s in zip(artefacts, plates, models, delays_s, strict=True):
            felt = _felt(clock, readings, plate.time - late_s, laboratory, model)
            artefact += model.predict(_held(felt, recording, plate, "the acceleration", notes))
        notes += compensation_doubts(laboratory.calibration, models[0], readings, treadmill)
    if laboratory.belts and treadmill.belt is not None:
        added = belt_wrenches(
            recording, laboratory.belts, treadmill.belt, [plate.time for plate in plates]
        )
        for artefact, plate, wrench in zip(artefacts, plates, added, strict=True):
            artefact += _held(wrench, recording, plate, "the belts' acceleration", notes)
    return artefacts, tuple(notes)


def compensation_doubts(
    calibration: Calibration, model: InertiaModel, readings: Array, treadmill: Treadmill
) -> list[Note]:
    """Find what is doubtful about a calibration and about a trial's accelerations (N, k)."""
    known = samples_of(readings, np.isfinite(readings).all(axis=1))
    return [*calibration.notes, *check_trial(model, known, treadmill.accelerometer_range_g)]


def _felt(
    clock: Array, readings: Array, time: Array, laboratory: Laboratory, model: InertiaModel
) -> Array:
    """Give the accelerations at a plate's times: readings unfiltered, differences filtered."""
    assert laboratory.calibration is not None
    treadmill, sensors = laboratory.treadmill, laboratory.calibration.sensors
    felt = at_plate_times(clock, readings, time, treadmill, sensors)
    if not model.lags_s:
        return felt
    assert model.setup is not None  # a calibration's models have one
    filtered = model.setup.low_pass(readings, clock)
    both = at_plate_times(clock, filtered, time, treadmill, sensors, model.lags_s)
    return np.hstack([felt, both[:, felt.shape[1] :]])


def _held(values: Array, recording: Recording, plate: Plate, what: str, notes: list[Note]) -> Array:
    try:
        held, held_s = hold_ends(plate.time, values, what)
    except ValueError as error:
        raise ValueError(f"{recording.source.name}: {error}") from error
    note = Note.of("compensation_held", held_s=held_s)
    if held_s > MIN_NOTED_S and note not in notes:
        notes.append(note)
    return held
