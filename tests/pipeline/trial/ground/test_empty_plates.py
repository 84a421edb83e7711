"""Of recordings of people beside a plate, those in which it is empty are fitted to it."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.config.schema import Treadmill
from pipeline.trial.ground.calibrations import fit_calibration
from pipeline.trial.ground.laboratory import Laboratory
from tests.pipeline import lab
from tests.pipeline.trial.ground.grounds import notes_on

TREADMILL = Treadmill(accelerometers=lab.CHANNELS)


def beside(*plates, name="beside.c3d", share=1.0, seed=1):
    """Somebody of 700 N stands on some plates for a share of the time; the platform pitches."""
    people = lab.without_people(20.0)
    loaded = []
    for plate in people.plates:
        wrench = plate.wrench_in_plate.copy()
        if plate.number in plates:
            rows = slice(0, round(share * len(wrench)))
            wrench[rows, 2] = 700.0 * plate.rotation[2, 2]
        loaded.append(replace(plate, wrench_in_plate=wrench))
    people = replace(people, plates=tuple(loaded), source=Path(name))
    return lab.on_platform(people, lab.shaken(20.0, seed), seed=seed)


def test_plates_are_fitted_to_the_recordings_in_which_they_are_empty(empty):
    alone = fit_calibration(empty, TREADMILL)
    others = [beside(2, name="right.c3d"), beside(name="boards.c3d", seed=2)]
    found = fit_calibration(empty, TREADMILL, beside=others)
    samples = {name: model.samples for name, model in found.plates.items()}
    once = alone.plates["plate 1"].samples
    assert samples == {"plate 1": pytest.approx(3 * once), "plate 2": pytest.approx(2 * once)}
    plates = r"right\.c3d: plate 1 .*; boards\.c3d: plate 1, plate 2 "
    assert re.match(plates, found.provenance["beside"])
    for name, model in found.plates.items():
        expected = alone.plates[name]
        np.testing.assert_allclose(model.sigma, expected.sigma, rtol=0.2)
        np.testing.assert_allclose(model.rms_slow, expected.rms_slow, rtol=0.3)


def stepped_on(number, name):
    """Somebody of 700 N steps on a plate for 0.3 s, four times in 20 s."""
    recording, plates = beside(name=name), []
    for plate in recording.plates:
        wrench = plate.wrench_in_plate.copy()
        if plate.number == number:
            wrench[(plate.time % 5.0 < 0.3), 2] += 700.0 * plate.rotation[2, 2]
        plates.append(replace(plate, wrench_in_plate=wrench))
    return replace(recording, plates=tuple(plates))


@pytest.mark.parametrize(
    ("recording", "message"),
    [
        (lambda: stepped_on(1, "a.c3d"), r"a.c3d: .*plate 1 .* \(\d+ N over 0.2 s"),
        (lambda: beside(1, name="a.c3d", share=0.4), r"plate 1 for a part"),
        (lambda: beside(1, 2, name="a.c3d"), r"a.c3d: .*every plate"),
    ],
)
def test_a_plate_that_is_empty_for_a_while_or_none_at_all_is_refused(empty, recording, message):
    with pytest.raises(ValueError, match=message):
        fit_calibration(empty, TREADMILL, beside=[recording()])


def test_a_recording_cannot_confirm_itself(empty):
    copy = replace(empty, source=Path("copy.c3d"))
    with pytest.raises(ValueError, match=r"copy\.c3d: .*same recording"):
        fit_calibration(empty, TREADMILL, beside=[copy])


def with_belts(recording, speed, unit="m/s"):
    """Add a channel with the speed of the belts."""
    analog = recording.analog
    values = np.column_stack([analog.values, np.full(len(analog.time), speed)])
    names, units = (*analog.names, "Belt.Left"), (*analog.units, unit)
    return replace(recording, analog=replace(analog, names=names, units=units, values=values))


def belt_notes(trial, calibration):
    notes = notes_on(trial, Laboratory(TREADMILL, calibration))
    return [n for n in notes if n.code.startswith("uncertainty") and "belt" in n.text]


def test_trials_whose_belts_are_faster_than_those_of_the_calibration_say_so(empty):
    others = [with_belts(beside(2), 1.3)]
    known = fit_calibration(with_belts(empty, 2.0), TREADMILL, beside=others)
    np.testing.assert_allclose(known.plates["plate 1"].model_error.belts_mps, [2.0, 1.3])
    np.testing.assert_allclose(known.plates["plate 2"].model_error.belts_mps, [2.0])
    assert belt_notes(with_belts(empty, 2.05), known) == []
    (faster,) = belt_notes(with_belts(empty, 2500.0, "mm/s"), known)
    assert faster.level == "warning"
    assert faster.values == pytest.approx({"speed_mps": 2.5, "calibrated_mps": 2.0})
    (unknown,) = belt_notes(empty, known)
    assert "2 m/s" in unknown.text
