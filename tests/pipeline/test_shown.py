"""Recordings, results and studies show in a session and in a notebook what they are."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from pipeline.config.schema import Settings, Subject
from pipeline.io.c3d.read import read_c3d
from pipeline.trial.residuals import residual_table


def test_a_result_shows_the_rms_of_its_residual_table_as_measured_and_compensated(processed):
    table = residual_table(processed, "pitch")
    for compensated, name in ((False, "measured"), (True, "compensated")):
        rows = table[table["headline"] & (table["compensated"] == compensated)]
        (line,) = (line for line in repr(processed).split("\n") if line.startswith(name))
        np.testing.assert_allclose([float(size) for size in line.split()[1:]], rows["rms"].round(1))


def test_a_result_without_residuals_shows_why_in_place_of_a_table(processed):
    none = replace(processed, quality=np.ones_like(processed.quality), shortage="no load")
    assert repr(none).endswith("no load")


def test_a_recording_shows_duration_markers_and_plates_with_their_rates(moving_study):
    recording = read_c3d(moving_study / "sub01_pitch.c3d")
    title, _, markers, plates, channels, events = repr(recording).split("\n")
    seconds = len(recording.markers.time) / recording.markers.rate_hz
    assert title == f"sub01_pitch.c3d: {seconds:.1f} s"
    assert markers.split()[1:] == [str(len(recording.markers.names)), "100", "Hz"]
    assert plates.split()[2:] == ["2", "1000", "Hz"]
    assert channels.split()[1] == str(len(recording.analog.names))
    assert events.split()[1] == str(len(recording.events))


def test_a_study_shows_how_many_recordings_each_subject_has_of_each_condition(study):
    title, conditions, *subjects = repr(study).split("\n")
    assert f"{len(study.to_process())} recordings" in title
    assert conditions.split() == [*study.file.conditions]
    assert [line.split()[0] for line in subjects] == [*study.subjects]
    assert sum(int(n) for line in subjects for n in line.split()[1:]) == len(study.to_process())


@pytest.mark.parametrize("name", ["processed", "study"])
def test_notebooks_show_the_same_as_a_table_and_sessions_fit_a_terminal(request, name):
    value = request.getfixturevalue(name)
    title = value.overview().title
    assert title in value._repr_html_()
    assert value._repr_html_().count("<tr") == 1 + len(value.overview().rows)
    assert max(map(len, repr(value).split("\n"))) <= 80


def test_a_printed_table_of_residuals_shows_plates_axis_and_rms_in_a_terminal(processed):
    table = residual_table(processed)
    with pd.option_context("display.width", 80, "display.max_columns", 0):
        heads, first, *_ = str(table).split("\n")
    assert heads.split()[:3] == ["compensated", "axis", "rms"]
    assert float(first.split()[3]) == pytest.approx(table["rms"][0])
    assert set(table["condition"]) == {processed.condition}


def test_subjects_settings_and_notes_are_shown_in_lines_of_a_terminal(processed):
    for value in (Subject(), Settings(), *processed.notes):
        assert max(map(len, repr(value).split("\n"))) <= 80
    assert "cutoff_hz=6.0" in str(Settings())
