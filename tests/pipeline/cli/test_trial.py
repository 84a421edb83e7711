"""What is printed of a trial and what is left on disk agree."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.cli.app import main
from pipeline.io.opensim import read_sto
from pipeline.run.store import read_trial
from pipeline.trial.quality import free_of
from pipeline.trial.residuals import marker_rows

AXES = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")


def processed(trial, out, *options):
    """What ``hbm residuals`` leaves: frames, summary, table of residuals."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", "200")
        assert main(["residuals", str(trial), "--out", str(out), *options]) == 0
    stem = out / trial.stem
    frames = pd.read_parquet(f"{stem}.parquet")
    return (
        frames,
        read_trial(Path(f"{stem}.parquet")),
        pd.read_csv(f"{stem}_residuals.csv"),
    )


@pytest.fixture(scope="module")
def real_trial(shared_data):
    return shared_data / "treadmill_hbm2" / "treadmill_events.c3d"


@pytest.fixture(scope="module")
def result(real_trial, tmp_path_factory):
    out = tmp_path_factory.mktemp("real") / "not" / "yet" / "there"
    return out, *processed(real_trial, out, "--mass-kg", "55.3", "--sex", "female")


def within_cycles(frames, summary):
    time = np.asarray(frames["time_s"])
    spans = [span for side in summary.cycles.values() for span in side]
    return np.any([(time >= start) & (time < stop) for start, stop in spans], axis=0)


def test_the_table_is_the_rms_of_the_frames_within_gait_cycles(result):
    _, frames, summary, table = result
    counts = free_of(frames["quality"].to_numpy())
    inside = frames[within_cycles(frames, summary) & counts]
    assert len(inside) > 1000
    assert tuple(table["axis"]) == AXES
    for axis, rms, mean in table[["axis", "rms", "mean"]].itertuples(index=False):
        residual = inside[f"residual.measured.{axis}"]
        assert rms == pytest.approx(np.sqrt(np.mean(residual**2)), rel=1e-5)
        assert mean == pytest.approx(residual.mean(), rel=1e-5)


def test_a_trial_alone_and_in_a_study_has_the_same_residuals(result, real_trial, tmp_path):
    (tmp_path / "study.toml").write_text("[conditions.walk]\n", encoding="utf-8")
    (tmp_path / "sub01.toml").write_text(
        'id = "sub01"\nsex = "female"\nmass_kg = 55.3\n'
        f'[trials.walk]\nfile = "{real_trial.as_posix()}"\n',
        encoding="utf-8",
    )
    assert main(["run", str(tmp_path), "--out", str(tmp_path / "out")]) == 0
    (study,) = (tmp_path / "out").glob("trials/*.parquet")
    stored, (_, _, alone, _) = read_trial(study), result
    np.testing.assert_array_equal(stored.measured.residual, alone.measured.residual)
    assert [*map(str, stored.notes)] == [*map(str, alone.notes)]


def test_every_gait_cycle_has_its_own_rows(result):
    """Numbered from 1; only frames that count count."""
    out, frames, summary, _ = result
    table = pd.read_csv(out / "treadmill_events_cycles.csv")
    counts = free_of(frames["quality"].to_numpy())
    for side, spans in summary.cycles.items():
        own = table[(table["side"] == side) & (table["axis"] == "Fy")]
        assert own["cycle"].tolist() == list(range(1, len(spans) + 1))
        np.testing.assert_allclose(own[["start_s", "stop_s"]], spans, rtol=1e-5)
        for (start, stop), row in zip(spans, own.itertuples(), strict=True):
            inside = (frames["time_s"] >= start) & (frames["time_s"] < stop)
            values = frames.loc[inside & counts, "residual.measured.Fy"]
            assert row.rms == pytest.approx(np.sqrt(np.mean(values**2)), rel=1e-5)
            assert row.peak == pytest.approx(values.abs().max(), rel=1e-5)
            assert row.valid_share == pytest.approx(
                (inside & counts).sum() / inside.sum(), rel=1e-5
            )
    assert 0.5 < table["valid_share"].min() < 1


def test_percentages_are_of_body_weight_and_of_body_weight_times_stature(result):
    *_, summary, table = result
    weight = 55.3 * 9.81
    stature = summary.body.height_m
    assert stature == pytest.approx(1.72, abs=0.005)
    scale = [weight] * 3 + [weight * stature] * 3
    np.testing.assert_allclose(table["rms_percent"], 100 * table["rms"] / scale, rtol=1e-4)


def test_what_is_printed_is_what_is_in_the_table(real_trial, tmp_path, capsys):
    filtered = ["--filter", "realtime", "--cutoff-hz", "8", "--plate-delay-ms", "-4"]
    *_, summary, table = processed(
        real_trial, tmp_path, "--mass-kg", "55.3", "--verbose", *filtered
    )
    assert summary.settings.plate_delay_s == -0.004
    out = capsys.readouterr().out
    assert f"{table['n_cycles'].iloc[0]} of {summary.found_cycles}" in out
    assert re.search(r"realtime .*\b8 Hz", out)
    lines = [line.split("│") for line in out.splitlines() if line.startswith("│")]
    lines = [cells for cells in lines if cells[1].strip()[:2] in AXES]
    assert [cells[1].strip()[:2] for cells in lines] == list(AXES)
    assert [cells[3].strip() for cells in lines] == [f"{rms:.1f}" for rms in table["rms"]]
    means = [f"{mean:z.1f}".replace("-", "−") for mean in table["mean"]]
    assert [cells[4].strip() for cells in lines] == means
    for note in summary.notes:
        assert str(note) in out
    worst = max(marker_rows(summary)[:-1], key=lambda row: row.rms_mm)
    assert f"{worst.marker} {worst.rms_mm:.1f}" in out


def test_a_trial_in_opensims_files_runs_the_same_way(shared_data, tmp_path):
    """Compared with OpenSim's own inverse dynamics of the same stride, whose model has no arms."""
    subject = shared_data / "opensim_subject01" / "subject01"
    options = {
        "--forces": f"{subject}_walk1_grf.mot",
        "--static": f"{subject}_static.trc",
        "--mass-kg": "72.6",
    }
    trial = subject.with_name("subject01_walk1.trc")
    words = [word for pair in options.items() for word in pair]
    _, summary, table = processed(trial, tmp_path, *words)
    theirs = read_sto(subject.with_name("inverse_dynamics.sto"))
    inside = within_cycles({"time_s": theirs.time}, summary)
    forces = np.stack([theirs.columns[f"pelvis_t{axis}_force"] for axis in "xyz"])
    peer = np.sqrt(np.mean(forces[:, inside] ** 2, axis=1))
    ours = table.set_index("axis").loc[["Fx", "Fy", "Fz"], "rms"]
    assert np.linalg.norm(ours) < np.linalg.norm(peer)
