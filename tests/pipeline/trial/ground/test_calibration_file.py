"""A calibration is the same from the empty treadmill's recording and from its file."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from compensation import Calibration, to_json
from hbm.markers import Markers
from pipeline.config.schema import Condition, StudyFile, Treadmill
from pipeline.config.study import Study
from pipeline.io.read_options import ReadOptions
from pipeline.trial.ground import laboratory
from pipeline.trial.ground.calibrations import fit_calibration, read_calibration, read_empty
from pipeline.trial.ground.laboratory import bind
from pipeline.trial.study_files import read_study_laboratory
from pipeline.virtual_lab.machine.c3d_file import write_c3d
from tests.pipeline import lab
from tests.pipeline.trial.ground.grounds import TREADMILL


def test_a_calibration_is_the_same_from_its_recording_and_from_its_file(
    tmp_path, empty, calibration
):
    path = lab.save(empty, tmp_path / "empty.c3d")
    fitted = read_calibration(path, TREADMILL)
    for name, model in calibration.plates.items():
        np.testing.assert_allclose(fitted.plates[name].sigma, model.sigma, rtol=0.02)
    stored = tmp_path / "empty.json"
    stored.write_text(to_json(fitted), encoding="utf-8")
    read = read_calibration(stored, TREADMILL)
    np.testing.assert_array_equal(read.plates["plate 1"].gain, fitted.plates["plate 1"].gain)


def test_a_channel_stated_as_another_axis_than_in_the_calibration_is_refused(calibration):
    """No signal shows which axis of a sensor it is, and compensation would be wrong."""
    facts, trial = {"channels": json.dumps(lab.CHANNELS)}, lab.without_people(2.0)
    known, trial = Calibration(calibration.plates, facts), lab.on_platform(trial, lab.still(2.0))
    bind(trial, laboratory.Laboratory(TREADMILL, known))
    sensor = next(iter(lab.CHANNELS))
    x, y, z = lab.CHANNELS[sensor]
    exchanged = Treadmill(accelerometers=lab.CHANNELS | {sensor: (y, x, z)})
    with pytest.raises(ValueError, match=rf"{sensor} was {x}, {y}, {z} "):
        bind(trial, laboratory.Laboratory(exchanged, known))


def test_a_stated_delay_that_is_not_that_of_the_calibration_is_refused(tmp_path, calibration):
    """The file decides; two delays would be two shifts."""
    late = tuple(replace(s, delay_s=0.004, delay_error_s=0.0001) for s in calibration.sensors)
    stored = tmp_path / "lab.json"
    stored.write_text(to_json(replace(calibration, sensors=late)), encoding="utf-8")
    read_calibration(stored, TREADMILL)
    read_calibration(stored, TREADMILL.model_copy(update={"accelerometer_delay_s": 0.004}))
    read_calibration(stored, TREADMILL.model_copy(update={"accelerometer_delay_s": 0.00405}))
    other = TREADMILL.model_copy(update={"accelerometer_delay_s": 0.0042})
    message = r"lab\.json: .* 4\.00 ms .*4\.20 ms"
    with pytest.raises(ValueError, match=message):
        read_calibration(stored, other)


def test_a_calibration_recording_is_fitted_once_until_it_changes(tmp_path):
    def fitted(**changes):
        treadmill = TREADMILL.model_copy(update={"calibration": "empty.c3d", **changes})
        file = StudyFile(treadmill=treadmill, conditions={"level": Condition()})
        return read_study_laboratory(Study(tmp_path, file, {}, None)).calibration

    path = tmp_path / "empty.c3d"
    lab.save(lab.on_platform(lab.without_people(8.0), lab.shaken(8.0)), path)
    first = fitted()
    assert fitted() is first
    assert fitted(cutoff_hz=10.0) is not first
    lab.save(lab.on_platform(lab.without_people(8.0), lab.shaken(8.0, seed=2)), path)
    assert fitted() is not first


@pytest.mark.parametrize("name", ["empty.json", "empty.c3d"])
def test_a_calibration_that_cannot_be_read_is_refused_with_its_file_name(tmp_path, name):
    path = tmp_path / name
    path.write_text("{", encoding="utf-8")
    with pytest.raises(ValueError, match=re.escape(name)):
        read_calibration(path, TREADMILL)


@pytest.mark.parametrize("motion", [lab.shaken(12.0), lab.still(12.0)])
def test_a_recording_with_somebody_on_the_treadmill_is_no_calibration(walker, tmp_path, motion):
    path = lab.save(lab.on_platform(walker, motion), tmp_path / "walk.c3d")
    message = r"walk\.c3d: .*(on the boards|hardly moved)"
    with pytest.raises(ValueError, match=message):
        read_calibration(path, TREADMILL)


def test_a_platform_that_only_shakes_under_a_person_is_no_calibration(walker, tmp_path):
    """Footfalls on an elastic base: some cm/s², which no command asked for."""
    trembling = lab.shaken(12.0)
    small = replace(trembling, sway=0.1 * trembling.sway, pitch=0.1 * trembling.pitch)
    path = lab.save(lab.on_platform(lab.without_people(12.0), small), tmp_path / "small.c3d")
    with pytest.raises(ValueError, match=r"moved too little .*0\.2"):
        read_calibration(path, TREADMILL)


@pytest.mark.parametrize("axes", ["left,back,up", "up,left,back"])
def test_an_empty_treadmill_without_markers_is_level(tmp_path, empty, calibration, axes):
    """Its plates show the vertical; directions about it do not matter."""
    nobody = Markers(empty.markers.time, (), np.empty((len(empty.markers.time), 0, 3)))
    path = tmp_path / "empty.c3d"
    write_c3d(path, nobody, empty.plates, analog=empty.analog, axes=axes)
    recording = read_empty(path, ReadOptions())
    for plate, expected in zip(recording.plates, empty.plates, strict=True):
        np.testing.assert_allclose(abs(plate.rotation[2]), abs(expected.rotation[2]), atol=1e-6)
    for name, model in fit_calibration(recording, TREADMILL).plates.items():
        np.testing.assert_allclose(model.gain, calibration.plates[name].gain, atol=1e-3)
