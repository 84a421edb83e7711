"""What the treadmill adds to its plates, sample by sample, is what `ground_wrenches` removes."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.config.schema import Treadmill
from pipeline.io.recording import Compensation
from pipeline.trial.ground.laboratory import Laboratory, bind
from pipeline.trial.ground.wrenches import plate_artefacts
from tests.pipeline import lab
from tests.pipeline.trial.ground.grounds import TREADMILL, ground_of

DONE = Compensation("hbm-residuals 0.2.0", (1, 2))


@pytest.fixture(scope="module")
def laboratory(calibration):
    return Laboratory(TREADMILL, calibration)


@pytest.fixture(scope="module")
def pitching(walker):
    return lab.on_platform(walker, lab.pitching(12.0))


def test_after_the_low_pass_the_plates_are_those_that_were_compensated_after_it(
    pitching, laboratory
):
    """Filters and gains are linear, so that it makes no difference which comes first."""
    artefacts, notes = plate_artefacts(bind(pitching, laboratory))
    columns = [pitching.analog.channel(name) for names in lab.CHANNELS.values() for name in names]
    readings = np.column_stack(columns) * 9.80665
    for plate, artefact in zip(pitching.plates, artefacts, strict=True):
        model = laboratory.calibration.plates[f"plate {plate.number}"]
        acceleration = model.setup.low_pass(readings, plate.time)
        measured = model.setup.low_pass(plate.wrench_in_plate, plate.time)
        expected = model.compensate(acceleration, measured)
        found = model.setup.low_pass(plate.wrench_in_plate - artefact, plate.time)
        span = np.ptp(plate.wrench_in_plate, axis=0)
        assert (np.abs(found - expected) < 1e-9 * span).all()
        assert (np.abs(artefact[2000:, :3]).max(axis=0) > 20).any()
    assert notes == ()


def test_a_gap_of_an_accelerometer_is_refused_with_its_time(pitching, laboratory):
    values = pitching.analog.values.copy()
    values[5000:5010, 2] = np.nan
    broken = replace(pitching, analog=replace(pitching.analog, values=values))
    with pytest.raises(ValueError, match=r"walk_0\.c3d: .*gap at 5\.000 s"):
        plate_artefacts(bind(broken, laboratory))


def test_compensated_plates_are_not_compensated_again(pitching, laboratory):
    again = replace(pitching, compensation=DONE)
    with pytest.raises(ValueError, match=r"compensated already.*0\.2\."):
        ground_of(again, laboratory, again.markers.time, 0.0)
    only_moving = Laboratory(laboratory.treadmill.model_copy(update={"calibration": None}))
    ground = ground_of(again, only_moving, again.markers.time, 0.0)
    assert set(ground.variants) == {"measured"}


def test_plates_in_the_lab_are_not_moved_with_the_platform_again(pitching, laboratory):
    in_lab = replace(pitching, compensation=replace(DONE, frame="lab"))
    moving = Laboratory(laboratory.treadmill)
    with pytest.raises(ValueError, match=r"--frame lab"):
        ground_of(in_lab, moving, in_lab.markers.time, 0.0)
    assert ground_of(in_lab, Laboratory(Treadmill()), in_lab.markers.time, 0.0).pose is None
