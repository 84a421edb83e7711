"""Where trunk markers are missing, what these determined follows no noise."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.config.schema import Settings, Subject
from pipeline.io.c3d.read import read_c3d
from pipeline.trial.process import process_recording
from pipeline.trial.residuals import residual_table
from tests.hbm.motions import with_noise, without

ARMS_AND_HEAD = {
    *("LFHD", "RFHD", "LBHD", "RBHD"),
    *(side + name for side in "LR" for name in ("UPA", "ELB", "FRM", "WRA", "WRB", "FIN")),
}
TRUNK = {"C7", "T2", "T6", "T10", "T12", "RBAK", "CLAV", "STRN", "LSHO", "RSHO"}
THREE = {"CLAV", "LSHO", "RSHO"}
TRIALS = {
    "child": ("overground_walks/HC030A01", "overground_walks/HC030A05", Subject(mass_kg=45.8)),
    "stairs": ("plug_in_gait/Static_trial", "plug_in_gait/Movement_trial", Subject(mass_kg=85.0)),
}


@pytest.fixture(scope="module", params=TRIALS)
def files(request, shared_data):
    static, trial, subject = TRIALS[request.param]
    return *(read_c3d(shared_data / f"{name}.c3d") for name in (static, trial)), subject


@pytest.fixture(scope="module")
def complete(files):
    return result_of(files, ())


@pytest.fixture(scope="module")
def noisy_by_three(files):
    """Two trials with three markers of the trunk and other noise."""
    return [result_of(files, SEEN_BY_THREE, seed) for seed in (1, 2)]


def result_of(files, gone, seed=None, method="zero_phase"):
    """Process a trial of which some markers are missing, static included, with 1 mm of noise."""
    static, trial, subject = files
    static, trial = (cut(recording, gone) for recording in (static, trial))
    if seed is not None:
        noisy = with_noise(trial.markers, np.random.default_rng(seed), 0.001)
        trial = replace(trial, markers=noisy)
    return process_recording(trial, subject, Settings(filter=method), static=static)


def cut(recording, gone):
    names = set(gone) & set(recording.markers.names)
    return replace(recording, markers=without(recording.markers, names))


def rms(result, axis="Fy"):
    return residual_table(result, "walk").drop_duplicates("axis").set_index("axis").loc[axis, "rms"]


def twist_deg(result):
    return np.degrees(result.motion.coordinate("TrunkLeftTwist"))


def codes(result):
    return {note.code for note in result.notes if note.level == "warning"}


SEEN_BY_THREE = (ARMS_AND_HEAD | TRUNK) - THREE
UNSEEN = ARMS_AND_HEAD | TRUNK


@pytest.mark.parametrize("method", ["zero_phase", "realtime"])
def test_a_trunk_of_three_markers_moves_as_with_all_and_leaves_less_residual_than_none(
    files, complete, method
):
    found, none = (result_of(files, gone, method=method) for gone in (SEEN_BY_THREE, UNSEEN))
    assert found.motion.converged.all()
    assert twist_deg(found).std() < 1.5 * twist_deg(complete).std()
    assert rms(found) < rms(none)


def change_by_noise(results, of):
    """RMS of how far two trials with other noise differ where both count."""
    one, other = results
    counts = one.counts & other.counts
    return np.sqrt(np.mean((of(one) - of(other))[counts] ** 2))


def test_noise_of_a_millimetre_moves_a_trunk_of_three_markers_hardly_more_than_a_complete_one(
    files, noisy_by_three
):
    assert change_by_noise(noisy_by_three, twist_deg) < 0.3
    found, least = (
        change_by_noise(results, lambda result: result.measured.residual[:, 1])
        for results in (noisy_by_three, [result_of(files, (), seed) for seed in (1, 2)])
    )
    assert found < 2 * least


def test_a_warning_names_what_three_markers_of_the_trunk_do_not_determine(noisy_by_three, complete):
    found = {note.code: note for note in noisy_by_three[0].notes}
    assert {"TrunkRightBend", "TrunkLeftTwist"} <= {
        *found["coordinates_held"].values["coordinates"]
    }
    assert found["mass_not_shown"].level == "warning"
    assert 0.3 < found["mass_not_shown"].values["share"] < 0.5
    assert "mass_not_shown" not in codes(complete)
