"""hbm calibration fit and check: sensors at fault, channels of any name, another day."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from compensation import from_json, to_json
from hbm.spatial import rotation_about
from pipeline.cli.app import main
from pipeline.config.study import read_study
from pipeline.run.check import check_study
from pipeline.trial.study_files import read_study_laboratory
from tests.pipeline import lab

SENSORS = {name: slice(3 * k, 3 * k + 3) for k, name in enumerate(lab.CHANNELS)}
STATED = [
    option
    for name, channels in lab.CHANNELS.items()
    for option in ("--accelerometer", f"{name}={','.join(channels)}")
]


def with_values(recording, change):
    values = recording.analog.values.copy()
    change(values)
    return replace(recording, analog=replace(recording.analog, values=values))


def empty(seed, **options):
    return lab.on_platform(lab.without_people(20.0), lab.shaken(20.0, seed), seed=seed, **options)


def fit(recording, folder, *options):
    path, out = lab.save(recording, folder / "empty.c3d"), folder / "lab.json"
    assert main(["calibration", "fit", str(path), "-o", str(out), *(options or STATED)]) == 0
    return from_json(out.read_text(encoding="utf-8"))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_late_sensor_and_one_with_a_wrong_gain_are_found_and_corrected(tmp_path, capsys, seed):
    perfect, late = empty(seed), empty(seed, accelerometer_delay_s=0.005)
    rear, front = SENSORS.values()

    def spoil(values):
        values[:, rear] = late.analog.values[:, rear]
        values[:, front] *= 1.03

    expected = fit(perfect, tmp_path)
    capsys.readouterr()
    found = fit(with_values(perfect, spoil), tmp_path)
    printed = " ".join(capsys.readouterr().out.split())
    assert "accelerometer rear_left is 5.0" in printed
    assert "accelerometer front_right reads +" in printed
    first, second = found.sensors
    assert abs(first.delay_s - 0.005) < 1.96 * first.delay_error_s
    assert abs(second.delay_s) < 1.96 * second.delay_error_s
    assert abs(first.gain - 1) < 1.96 * first.gain_error
    assert abs(second.gain - 1.03) < 1.96 * second.gain_error
    for plate, model in found.plates.items():
        np.testing.assert_allclose(
            model.rms_compensated, expected.plates[plate].rms_compensated, rtol=0.1
        )


def test_a_calibration_from_before_sensors_were_described_is_used_as_it_was(tmp_path):
    document = json.loads(to_json(fit(empty(1), tmp_path))) | {"version": 2}
    del document["sensors"]
    for plate in document["plates"].values():
        del plate["correlation"], plate["rms_slow"]
    old = from_json(json.dumps(document))
    assert old.sensors == ()
    np.testing.assert_array_equal(old.plates["plate 1"].rms_slow,
                                  old.plates["plate 1"].rms_compensated)  # fmt: skip


@pytest.mark.parametrize("missing", ["correlation", "rms_slow", "sensors", "model_error"])
def test_a_calibration_of_today_that_lacks_a_part_is_damaged(tmp_path, missing):
    document = json.loads(to_json(fit(empty(1), tmp_path)))
    for part in (document, *document["plates"].values()):
        part.pop(missing, None)
    with pytest.raises(ValueError, match=f"the calibration is damaged: '{missing}'"):
        from_json(json.dumps(document))


def test_people_beside_an_empty_plate_are_fitted_too(tmp_path, capsys):
    boards = lab.save(empty(2), tmp_path / "boards.c3d")
    found = fit(empty(1), tmp_path, *STATED, "--beside", str(boards))
    alone = fit(empty(1), tmp_path)
    assert found.plates["plate 1"].samples > 1.9 * alone.plates["plate 1"].samples
    printed = " ".join(capsys.readouterr().out.split())
    assert "fitted too: boards.c3d: plate 1, plate 2 empty; weight" in printed
    assert found.provenance["beside"] == "boards.c3d: plate 1, plate 2 empty"
    assert "beside" not in alone.provenance


def renamed(recording):
    analog = recording.analog
    names = tuple(f"ch{k}" if k < 7 else name for k, name in enumerate(analog.names, 1))
    return replace(recording, analog=replace(analog, names=names))


def test_channels_of_any_name_are_stated(tmp_path, capsys):
    path = lab.save(renamed(empty(1)), tmp_path / "empty.c3d")
    out = tmp_path / "lab.json"
    command = ["calibration", "fit", str(path), "-o", str(out)]
    assert main(command) == 2
    assert "--accelerometer rear=CH1,CH2,CH3" in capsys.readouterr().err
    stated = ["--accelerometer", "rear=ch1,ch2,ch3", "--accelerometer", "front=ch4, ch5, ch6"]
    assert main([*command, *stated]) == 0
    assert from_json(out.read_text(encoding="utf-8")).plates["plate 1"].sensors == ("rear", "front")
    assert main(["calibration", "check", str(out), str(path)]) == 0
    for wrong in ("rear=ch1,ch2", "ch1,ch2,ch3", "=ch1,ch2,ch3", "rear=ch1,,ch3"):
        assert main([*command, "--accelerometer", wrong]) == 2
        assert "expected a name and three channels" in capsys.readouterr().err


def test_a_trial_needs_the_channels_of_its_calibration(moving_study, tmp_path, capsys):
    fitted, out = tmp_path / "lab.json", tmp_path / "out"
    fit(empty(1), tmp_path)
    trial = ["residuals", str(moving_study / "sub01_pitch.c3d"), "--out", str(out)]
    (one, first), (two, second) = lab.CHANNELS.items()
    exchanged = [f"{one}={','.join(second)}", f"{two}={','.join(first)}"]
    options = ["--calibration", str(fitted)]
    for text in exchanged:
        options += ["--accelerometer", text]
    assert main([*trial, *options]) == 2
    line = capsys.readouterr().err
    assert "recording and calibration need the same channels" in line
    assert line.count("\n") == 1
    assert main([*trial, "--calibration", str(fitted), "--accelerometer", exchanged[0]]) == 2
    assert "name all of them and no others" in capsys.readouterr().err
    assert main([*trial, "--accelerometer", exchanged[0]]) == 2
    assert "no effect without --calibration" in capsys.readouterr().err


def turned(values):
    rear = SENSORS["rear_left"]
    values[:, rear] = values[:, rear] @ rotation_about(np.array([0.0, 0, 1]), np.radians(4)).T


def inverted(values):
    values[:, SENSORS["rear_left"]] *= -1


def dead(values):
    values[:, SENSORS["rear_left"]] = 0.0


def exchanged(values):
    one, other = SENSORS.values()
    values[:, one], values[:, other] = values[:, other].copy(), values[:, one].copy()


@pytest.mark.parametrize(
    ("change", "code", "said"),
    [
        (lambda values: None, 0, "the calibration is still valid by day2.c3d"),
        (turned, 1, "accelerometer rear_left was turned by 4.0 ±"),
        (inverted, 1, "rear_left is turned by 180° since the calibration: it is upside down"),
        (dead, 1, "rear_left reads a median of 0 m/s²"),
        (exchanged, 1, "look swapped: exchanged, they match the calibration"),
    ],
)
def test_a_recording_of_another_day_says_whether_a_calibration_is_valid(
    tmp_path, capsys, change, code, said
):
    fit(empty(1), tmp_path)
    day2 = lab.save(with_values(empty(2), change), tmp_path / "day2.c3d")
    assert main(["calibration", "check", str(tmp_path / "lab.json"), str(day2)]) == code
    assert said in " ".join(capsys.readouterr().out.split())


def test_a_recording_with_somebody_on_it_checks_nothing(walker, tmp_path, capsys):
    fit(empty(1), tmp_path)
    day2 = lab.save(lab.on_platform(walker, lab.shaken(12.0)), tmp_path / "day2.c3d")
    assert main(["calibration", "check", str(tmp_path / "lab.json"), str(day2)]) == 2
    assert "was somebody on the boards?" in capsys.readouterr().err


def test_a_study_names_a_recording_of_another_day_and_its_trials_carry_the_verdict(
    moving_study, tmp_path, capsys
):
    study = tmp_path / "study"
    shutil.copytree(moving_study, study)
    text = (study / "study.toml").read_text(encoding="utf-8")
    stated = text.replace("[treadmill]\n", '[treadmill]\ncheck = "day2.c3d"\n')
    (study / "study.toml").write_text(stated, encoding="utf-8")
    lab.save(with_values(empty(2), turned), study / "day2.c3d")
    loaded = read_study(study)
    remarks = [r.note.code for r in check_study(loaded).remarks if r.place == "day2.c3d"]
    assert remarks == ["calibration_sensor_turned"]
    assert [n.code for n in read_study_laboratory(loaded).notes] == ["calibration_sensor_turned"]
    run = ["run", str(study), "--subject", "sub01", "--condition", "pitch", "--out"]
    assert main([*run, str(tmp_path / "results")]) == 0
    assert "rear_left was turned by 4" in " ".join(capsys.readouterr().out.split())


def test_a_check_without_a_calibration_is_refused(moving_study, tmp_path):
    (tmp_path / "study.toml").write_text('[treadmill]\ncheck = "day2.c3d"\n[conditions.level]\n')
    with pytest.raises(ValueError, match="check: has no effect without a calibration"):
        read_study(tmp_path)


def test_a_calibration_that_does_not_know_its_belts_says_so_when_it_is_fitted_and_checked(
    moving_study, tmp_path, capsys
):
    fit(empty(1), tmp_path)
    assert "does not know how fast the belts run in empty.c3d" in " ".join(
        capsys.readouterr().out.split()
    )
    codes = [remark.note.code for remark in check_study(read_study(moving_study)).remarks]
    assert "uncertainty_calibration_belts_unknown" in codes
