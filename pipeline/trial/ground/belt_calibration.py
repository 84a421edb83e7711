"""Calibration of the belts: what their acceleration adds to plates."""

from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from compensation import BeltModel, fit_belt, low_pass, to_json
from compensation.inertia.quality import OF_CALIBRATION
from compensation.inertia.sensors import FAULTS
from hbm.notes import Note
from hbm.signals.resampling import interpolate
from pipeline.config.schema import Belt
from pipeline.io.input_file import naming
from pipeline.io.recording import Recording
from pipeline.io.stated import Stated
from pipeline.trial.ground.belts import belt_accelerations, belt_side
from pipeline.trial.ground.calibration_recording import FILTER, read_empty
from pipeline.trial.ground.corrected_plates import with_corrected_plates
from pipeline.trial.ground.laboratory import Laboratory, once_in_a_process
from pipeline.trial.ground.wrenches import plate_artefacts

FILTER_EDGE_S: Final = 0.5
"""Left out at both ends of the calibration, where the low-pass has no neighbours."""


def belts_alone(recording: Recording, laboratory: Laboratory) -> tuple[Recording, tuple[Note, ...]]:
    """Correct the plates of a belt calibration as those of trials are, but for the belts.

    Belts accelerate at random, nobody is on them, and the platform is at rest. What the
    accelerometers explain is subtracted: accelerating belts shake the platform too, and of a trial
    that is subtracted before the belts' part is. A note says where the recording lacks their
    channels, so that what the belts shake is still in its plates, or where its accelerations are
    doubtful. A ValueError where an accelerometer is faulty, and as of `plate_artefacts`.
    """
    recording = with_corrected_plates(recording, laboratory.plates)
    if laboratory.calibration is None:
        return recording, ()
    channels = {name for names in laboratory.treadmill.accelerometers.values() for name in names}
    present = set() if recording.analog is None else set(recording.analog.names)
    if not channels <= present:
        missing = Note.of("belts_without_accelerometers", recording=recording.source.name)
        return recording, (missing,)
    file = recording.source.name
    with naming(recording.source):
        artefacts, found = plate_artefacts(recording, replace(laboratory, belts=()))
    if faults := [note.text for note in found if note.code in FAULTS]:
        raise ValueError(f"{file}: the belts' calibration needs its accelerometers: {faults[0]}")
    doubts = tuple(note.text for note in found if note.code not in OF_CALIBRATION)
    plates = tuple(
        replace(plate, wrench_in_plate=plate.wrench_in_plate - artefact)
        for plate, artefact in zip(recording.plates, artefacts, strict=True)
    )
    notes = (Note.of("belts_recording_doubtful", recording=file, doubts=doubts),) if doubts else ()
    return replace(recording, plates=plates), notes


def fit_belts(recording: Recording, belt: Belt) -> tuple[BeltModel, ...]:
    """Fit what accelerating belts add to their empty plates: one model per plate, at 100 Hz.

    Belts accelerate at random, nobody is on them, and the platform is at rest. A ValueError where a
    channel is missing or the fit is not possible.
    """
    if not recording.plates:
        raise ValueError(
            f"{recording.source.name}: the belt calibration needs plates: {recording.why_no_plates}"
        )
    models = []
    for plate, (time, acceleration) in belt_accelerations(recording, belt):
        pitch_moment = plate.wrench_in_plate[:, 3:] @ belt_side(plate)
        filtered = low_pass(pitch_moment, plate.rate_hz, belt.cutoff_hz, FILTER)
        moment = interpolate(plate.time, filtered, time)
        inside = (time > time[0] + FILTER_EDGE_S) & (time < time[-1] - FILTER_EDGE_S)
        inside &= np.isfinite(moment)
        try:
            model = fit_belt(acceleration[inside], moment[inside] - moment[inside].mean())
        except ValueError as error:
            raise ValueError(f"{recording.source.name}: plate {plate.number}: {error}") from error
        models.append(model)
    return tuple(models)


def read_belts(
    path: Path, laboratory: Laboratory, stated: Stated
) -> tuple[tuple[BeltModel, ...], tuple[Note, ...]]:
    """Fit the belt models to a recording of the empty treadmill; once in a process.

    The laboratory has the belts as stated, the correction of the plates, and the calibration of the
    platform by which trials are compensated. No models where no belts are stated; notes are those
    of `belts_alone`.
    """
    belt, plates, calibration = (
        laboratory.treadmill.belt,
        laboratory.plates,
        laboratory.calibration,
    )
    if belt is None:
        return (), ()

    def fitted() -> tuple[tuple[BeltModel, ...], tuple[Note, ...]]:
        recording = read_empty(path, stated, any_forward=plates is None)
        alone, notes = belts_alone(recording, laboratory)
        return fit_belts(alone, belt), notes

    known = None if calibration is None else to_json(calibration)
    treadmill = laboratory.treadmill
    return once_in_a_process(fitted, "belts", (path,), treadmill, known, plates, stated)
