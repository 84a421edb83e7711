"""The demonstration from start to end: its files exist, and its residuals are right."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from hbm.spatial import shift_wrench
from pipeline.cli.study import demo
from pipeline.config.study import read_study
from pipeline.run.load import collect
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.process import process_recording
from pipeline.trial.residuals import residual_table
from pipeline.virtual_lab.machine.instrumented_treadmill import make_treadmill
from pipeline.virtual_lab.protocol import walking_protocol
from pipeline.virtual_lab.protocol.walking_protocol import Protocol, Setting
from pipeline.virtual_lab.protocol.walking_trial import run_trial, study_subject

pytestmark = pytest.mark.slow
PROTOCOL = Protocol(subjects=2, baseline_s=20.0, pitch_s=35.0, waits_s=(12.0, 14.0), beside_s=12.0)
QUANTILE_95 = 1.96
CLOSE = 2.0  # N and N·m: half a percent of the largest artefact
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


def test_compensated_moments_are_close_to_the_true_ones_where_the_treadmill_moves(out):
    """RMS errors of leg moments [N·m/kg] against the person's true mechanics."""
    page = (out / "results" / "report.html").read_text(encoding="utf-8")
    table = page[page.index("Errors of leg moments in this simulated study") :]
    heads = re.findall(r"<th[^>]*>([^<]+)</th>", table[: table.index("</thead>")])
    error = {}
    for joint in ("hip flexion", "hip abduction", "knee flexion", "ankle plantarflexion"):
        row = table[table.index(f">{joint}<") :]
        values = re.findall(r">\s*([\d.]+)\s*<", row[: row.index("</tr>")])
        error[joint] = dict(zip(heads[1:], map(float, values), strict=True))
    assert all(own[f"{name}, IC"] < 0.2 for own in error.values() for name in PROTOCOL.conditions)
    assert error["hip flexion"]["pitch, no IC"] > 10 * error["hip flexion"]["pitch, IC"]
    assert error["hip abduction"]["sway, no IC"] > 10 * error["hip abduction"]["sway, IC"]
