"""The demonstration leaves every file that it names, and its residuals are right."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from hbm.coordinates import COORDINATES, SIDES
from hbm.spatial import shift_wrench
from pipeline.cli.study import demo
from pipeline.config.study import read_study
from pipeline.figures.joints import LEG
from pipeline.run.load import collect
from pipeline.run.store import read_trial
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.process import process_recording
from pipeline.trial.residuals import residual_table
from pipeline.virtual_lab.machine.instrumented_treadmill import make_treadmill
from pipeline.virtual_lab.protocol import walking_protocol
from pipeline.virtual_lab.protocol.walking_protocol import Protocol, Setting
from pipeline.virtual_lab.protocol.walking_trial import run_trial, study_subject

pytestmark = pytest.mark.slow
PROTOCOL = Protocol(subjects=1, baseline_s=20.0, pitch_s=35.0, waits_s=(12.0, 14.0), beside_s=12.0)
QUANTILE_95 = 1.96
CLOSE = 2.0  # N and N·m: half a percent of the largest artefact
MOMENTS = (
    *(("hip", "flexion"), ("hip", "abduction")),
    *(("knee", "flexion"), ("ankle", "plantarflexion")),
)
MOST_CHANGED = (("pitch", ("hip", "flexion")), ("sway", ("hip", "abduction")))
ARTEFACTS = {"sway": ["Fy", "Mx", "Mz"], "pitch": ["Fx", "My"]}


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demo")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(walking_protocol, "DEMO", PROTOCOL)
        assert demo(jobs=2, out=folder) == 0
    return folder


@pytest.fixture(scope="module")
def rms(out):
    """RMS residuals, a column for each kind of plates: by subject, condition and axis."""
    table = collect(out / "results").residuals
    table = table[table["headline"]]
    assert dict(zip(table["condition"], table["window"], strict=True))["sway"] == "motion"
    return table.pivot(index=["subject", "condition", "axis"], columns="compensated", values="rms")


@pytest.fixture(scope="module")
def without_artefact(out):
    """RMS residuals when what the treadmill adds and the plates' zeros are known and removed."""
    study, setting = read_study(out / "study"), Setting(protocol=PROTOCOL)
    treadmill = make_treadmill(setting.faults, setting.seed)
    delays = setting.faults.plates.delays_s
    lab = Laboratory(study.file.treadmill.model_copy(update={"calibration": None}))
    tables = []
    for number, (name, subject) in enumerate(study.subjects.items()):
        virtual = study_subject(setting, number)
        for condition in PROTOCOL.conditions:
            trial = run_trial(setting, treadmill, virtual, number, condition)
            plates = []
            for plate, added, late, instrument in zip(
                trial.recording.plates,
                trial.response.artefacts,
                delays,
                treadmill.plates,
                strict=True,
            ):
                seen = [np.interp(plate.time - late, plate.time, column) for column in added.T]
                known = np.transpose(seen) + instrument.offset  # a calibration takes both away
                wrench = plate.wrench_in_plate - shift_wrench(known, plate.center)
                plates.append(replace(plate, wrench_in_plate=wrench))
            result = process_recording(
                replace(trial.recording, plates=tuple(plates)),
                subject.person,
                study.file.settings,
                laboratory=lab,
                condition=study.condition(condition),
            )
            tables.append(residual_table(result, condition).assign(subject=name))
    table = pd.concat(tables)
    return table[table["headline"]].set_index(["subject", "condition", "axis"])["rms"]


@pytest.mark.parametrize("condition", ARTEFACTS)
def test_compensation_takes_nine_tenths_of_every_artefact_away(rms, condition):
    table = rms.query("condition == @condition and axis in @ARTEFACTS[@condition]")
    assert (table[True] < 0.1 * table[False]).all(), table


def test_compensated_residuals_are_what_they_would_be_without_a_moving_treadmill(
    out, rms, without_artefact
):
    """Two RMS differ by no more than the RMS of what compensation leaves, whose size is stated."""
    table = collect(out / "results").residuals.query("headline and compensated")
    stated = table.set_index(["subject", "condition", "axis"])["compensation_sd"]
    off = (rms[True] - without_artefact).abs()
    assert (off < QUANTILE_95 * stated).all(), off / stated
    assert off.max() < CLOSE, off
    assert (rms[False] - without_artefact).abs().max() > 100 * CLOSE


def moment_rms(trial, truth, joint, direction):
    """RMS error of a leg moment [N·m/kg], measured and compensated, in the frames that count."""
    (motion,) = (m for m in LEG if (m.joint, m.direction) == (joint, direction))
    found = {}
    for variant, dynamics in trial.variants.items():
        errors = []
        for side in SIDES:
            k, _ = motion.column(side)
            true = np.interp(trial.motion.time, truth["time"], truth[f"moment_{COORDINATES[k]}"])
            errors.append((dynamics.tau[:, k] - true)[trial.counted] / trial.body.mass)
        found[variant] = float(np.sqrt(np.nanmean(np.square(errors))))
    return found


def test_compensated_moments_are_close_to_the_true_ones_where_the_treadmill_moves(out):
    for condition in PROTOCOL.conditions:
        trial = read_trial(out / "results" / "trials" / f"sub01_{condition}.parquet")
        truth = pd.read_parquet(out / "study" / "truth" / f"sub01_{condition}.parquet")
        error = {
            (joint, direction): moment_rms(trial, truth, joint, direction)
            for joint, direction in MOMENTS
        }
        assert all(rms["compensated"] < 0.2 for rms in error.values()), error
        for moved, moment in MOST_CHANGED:
            if condition == moved:
                assert error[moment]["measured"] > 10 * error[moment]["compensated"], error
