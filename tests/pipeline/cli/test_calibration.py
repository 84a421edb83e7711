"""``hbm calibration`` names sensors at fault, takes any channel names, and judges another day."""

import json
import shutil
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from compensation import from_json
from hbm.spatial import rotation_about
from pipeline.cli.app import main
from pipeline.config.schema import Treadmill
from pipeline.config.study import read_study
from pipeline.live.preparation import prepare
from pipeline.run.check import check_study
from pipeline.run.store import read_trial
from pipeline.trial.ground.calibrations import fit_calibration
from pipeline.trial.study_files import read_study_laboratory
from pipeline.virtual_lab.faults import BeltFaults, Faults
from pipeline.virtual_lab.machine.instrumented_treadmill import make_treadmill
from pipeline.virtual_lab.protocol.walking_protocol import DEMO, Setting
from pipeline.virtual_lab.protocol.walking_trial import run_calibration
from tests.pipeline import lab

LONG_S = 12.0
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


@cache
def empty(seed, **options):
    return lab.on_platform(
        lab.without_people(LONG_S), lab.shaken(LONG_S, seed), seed=seed, **options
    )


def fit(recording, folder, *options):
    path, out = lab.save(recording, folder / "empty.c3d"), folder / "lab.json"
    assert main(["calibration", "fit", str(path), "-o", str(out), *(options or STATED)]) == 0
    return from_json(out.read_text(encoding="utf-8"))


def test_a_late_sensor_is_found_and_corrected_and_a_wrong_gain_does_no_harm(fitted, tmp_path):
    perfect, late = empty(1), empty(1, accelerometer_delay_s=0.005)
    rear, front = SENSORS.values()

    def spoil(values):
        values[:, rear] = late.analog.values[:, rear]
        values[:, front] *= 1.03

    expected = from_json(fitted.read_text(encoding="utf-8"))
    found = fit(with_values(perfect, spoil), tmp_path)
    first, second = found.sensors
    assert abs(first.delay_s - 0.005) < 1.96 * first.delay_error_s
    assert abs(second.delay_s) < 1.96 * second.delay_error_s
    for plate, model in found.plates.items():
        np.testing.assert_allclose(
            model.rms_compensated, expected.plates[plate].rms_compensated, rtol=0.1
        )


def test_people_beside_an_empty_plate_are_fitted_too(fitted, tmp_path):
    boards = lab.save(empty(2), tmp_path / "boards.c3d")
    found = fit(empty(1), tmp_path, *STATED, "--beside", str(boards))
    alone = from_json(fitted.read_text(encoding="utf-8"))
    assert found.plates["plate 1"].samples > 1.9 * alone.plates["plate 1"].samples


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
    other = lab.save(renamed(empty(2)), tmp_path / "day2.c3d")
    assert main(["calibration", "check", str(out), str(other)]) == 0
    assert main([*command, "--accelerometer", "rear=ch1,ch2"]) == 2
    assert "three channels" in capsys.readouterr().err


def test_a_trial_needs_the_channels_of_its_calibration(fitted, moving_study, tmp_path, capsys):
    trial = ["residuals", str(moving_study / "sub01_pitch.c3d"), "--out", str(tmp_path / "out")]
    (one, first), (two, second) = lab.CHANNELS.items()
    others = [f"{one}={','.join(first[::-1])}", f"{two}={','.join(second)}"]
    options = ["--calibration", str(fitted)]
    for text in others:
        options += ["--accelerometer", text]
    assert main([*trial, *options]) == 2
    assert "the same channels" in capsys.readouterr().err


def exchanged(values):
    values[:, :6] = values[:, [3, 4, 5, 0, 1, 2]]


def test_sensors_that_exchanged_their_channels_are_named_and_given_right(fitted, tmp_path, capsys):
    day2 = lab.save(with_values(empty(2), exchanged), tmp_path / "day2.c3d")
    command = ["calibration", "check", str(fitted), str(day2)]
    assert main(command) == 1
    assert "are exchanged" in " ".join(capsys.readouterr().out.split())
    (one, first), (two, second) = lab.CHANNELS.items()
    for sensor, channels in ((one, second), (two, first)):
        command += ["--accelerometer", f"{sensor}={','.join(channels)}"]
    assert main(command) == 0


def test_the_recording_that_a_calibration_was_fitted_to_is_no_check_of_it(fitted, tmp_path, capsys):
    copied = shutil.copy(fitted.with_name("empty.c3d"), tmp_path / "day2.c3d")
    assert main(["calibration", "check", str(fitted), str(copied)]) == 2
    assert "fitted to it" in capsys.readouterr().err


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """The file of a calibration."""
    folder = tmp_path_factory.mktemp("fitted")
    fit(empty(1), folder)
    return folder / "lab.json"


def turned(values):
    rear = SENSORS["rear_left"]
    values[:, rear] = values[:, rear] @ rotation_about(np.array([0.0, 0, 1]), np.radians(4)).T


def dead(values):
    values[:, SENSORS["rear_left"]] = 0.0


@pytest.mark.parametrize(
    ("change", "code", "said"),
    [
        (lambda values: None, 0, "still valid"),
        (turned, 1, "plate 1: Fx left"),
        (dead, 1, "rear_left 0 m/s²"),
    ],
)
def test_a_recording_of_another_day_says_whether_a_calibration_is_valid(
    fitted, tmp_path, capsys, change, code, said
):
    day2 = lab.save(with_values(empty(2), change), tmp_path / "day2.c3d")
    assert main(["calibration", "check", str(fitted), str(day2)]) == code
    assert said in " ".join(capsys.readouterr().out.split())


def test_a_study_names_a_recording_of_another_day_and_its_trials_carry_the_verdict(
    moving_study, tmp_path
):
    study = shutil.copytree(moving_study, tmp_path / "study")
    text = (study / "study.toml").read_text(encoding="utf-8")
    stated = text.replace("[treadmill]\n", '[treadmill]\ncheck = "day2.c3d"\n')
    (study / "study.toml").write_text(stated, encoding="utf-8")
    lab.save(with_values(empty(2), turned), study / "day2.c3d")
    loaded = read_study(study)
    remarks = [r.said.code for r in check_study(loaded).remarks if r.place == "study.toml"]
    assert remarks == ["calibration_outdated"]
    assert [n.code for n in read_study_laboratory(loaded).notes] == ["calibration_outdated"]


def poor(recording):
    """The same empty treadmill, whose plates also carry a moment of 12 N·m that no sensor shows."""
    plates = []
    for plate in recording.plates:
        wrench = plate.wrench_in_plate.copy()
        wrench[:, 3] += 12 * np.sin(2 * np.pi * 3.3 * plate.time)
        plates.append(replace(plate, wrench_in_plate=wrench))
    return replace(recording, plates=tuple(plates))


BEYOND = "calibration above its limits"
PITCH = 4  # My: plates that are not yet in a file have the lab's axes


def spoilt(moving_study, tmp_path):
    """A study with one trial whose calibration fails its limits."""
    study = shutil.copytree(moving_study, tmp_path / "study")
    (study / "sub02.toml").unlink()
    lab.save(poor(empty(0)), study / "empty.c3d")
    return study


def failed(file):
    verdict = from_json(file.read_text(encoding="utf-8")).verdict
    return {
        (plate, row.component) for plate, rows in verdict.items() for row in rows if not row.passed
    }


def test_the_verdict_on_a_fitted_file_is_said_by_fit_check_residuals_and_export(
    fitted, moving_study, tmp_path, capsys
):
    study = spoilt(moving_study, tmp_path)
    file, trial, empty_again = tmp_path / "lab.json", study / "sub01_pitch.c3d", study / "again.c3d"
    lab.save(poor(empty(2)), empty_again)
    for command in (
        ["calibration", "fit", str(study / "empty.c3d"), "-o", str(file), *STATED],
        ["calibration", "check", str(file), str(empty_again)],
        ["residuals", str(trial), "--calibration", str(file), "--out", str(tmp_path / "out")],
        [
            "export",
            str(trial),
            "--format",
            "c3d",
            "--out",
            str(tmp_path / "c"),
            "--calibration",
            str(file),
        ],
    ):
        assert main(command) == 0
        assert BEYOND in " ".join(capsys.readouterr().out.split())
    assert failed(file) == {("plate 1", "Mx"), ("plate 2", "Mx")}
    assert failed(fitted) == set()


def test_the_verdict_on_a_recording_of_the_study_is_in_everything_that_a_run_leaves(
    moving_study, tmp_path, capsys, undrawn
):
    study, out = spoilt(moving_study, tmp_path), tmp_path / "results"
    main(["check", str(study)])
    assert BEYOND in " ".join(capsys.readouterr().out.split())
    chosen = ["--subject", "sub01", "--condition", "pitch"]
    for _ in range(2):  # the second time the trial is there already
        assert main(["run", str(study), *chosen, "--out", str(out)]) == 0
        assert " ".join(capsys.readouterr().out.split()).count(BEYOND) == 1
    assert main(["report", str(out), "--no-pages"]) == 0
    stated = json.loads((out / "study.json").read_text(encoding="utf-8"))["calibration"]
    assert [note["code"] for note in stated] == ["calibration_leaves_much"]
    summary = read_trial(out / "trials" / "sub01_pitch.parquet", frames=False)
    assert [n.level for n in summary.of_calibration] == ["warning"]
    assert BEYOND in (out / "report.html").read_text(encoding="utf-8")
    assert any(BEYOND in note.text for note in prepare(study, "sub01").notes)


@pytest.mark.slow
def test_what_the_calibration_of_the_demo_leaves_of_the_pitch_moment_is_of_its_belts():
    def fitted(belts):
        setting = Setting(protocol=DEMO, faults=Faults(belts=belts))
        recording = run_calibration(setting, make_treadmill(setting.faults, setting.seed))
        channels = {s: tuple(f"{s}.{a}" for a in "XYZ") for s in ("rear_left", "front_right")}
        return fit_calibration(recording, Treadmill(accelerometers=channels))

    demo, even = fitted(BeltFaults()), fitted(BeltFaults(unbalance_kg_per_m=0, roughness=0))
    for with_belts, without in zip(demo.verdict.values(), even.verdict.values(), strict=True):
        assert without[PITCH].left < 0.15 * with_belts[PITCH].left
