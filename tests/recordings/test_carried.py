"""What counts in real recordings are the frames in which the plates carry the subject.

Treadmill walking is recorded on both plates throughout, so what a plate that misses steps hides of
it is known: wherever frames count, the residual has to be that of the whole recording.
"""

from dataclasses import replace

import numpy as np
import pytest

from hbm.spatial import GRAVITY_MPS2
from pipeline.cli.app import main
from pipeline.config.schema import Settings, Subject, Treadmill
from pipeline.export.tables import write_tables
from pipeline.io.c3d.read import read_c3d
from pipeline.io.opensim import read_sto
from pipeline.run.store import read_trial
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.process import process_recording
from pipeline.trial.quality import NO_SUPPORT, Quality, free_of
from pipeline.trial.residuals import residual_table
from tests.hbm import motions
from tests.pipeline.live.playing import arrivals, chain_of, play
from tests.recordings import recorded

WOMAN = Subject(sex="female", mass_kg=55.3)


@pytest.fixture(scope="module")
def treadmill(shared_data):
    return recorded.recorded(recorded.treadmill, shared_data)[0]


@pytest.fixture(scope="module")
def whole(shared_data):
    return recorded.processed(recorded.treadmill, shared_data)


def with_plates(recording, change):
    """The recording with every plate's wrench changed: ``change`` gives a factor over time."""
    plates = tuple(
        replace(p, wrench_in_plate=p.wrench_in_plate * np.reshape(change(p), (-1, 1)))
        for p in recording.plates
    )
    return replace(recording, plates=plates)


def without(number, start_s, stop_s):
    """The factor of a plate that does not record for a time."""
    return lambda p: np.where((p.number == number) & (start_s < p.time) & (p.time < stop_s), 0, 1)


def again(recording):
    return process_recording(recording, WOMAN, Settings())


def codes(result):
    return [note.code for note in result.notes]


def rms(result, axis):
    return residual_table(result, "walk").set_index("axis").loc[axis, "rms"]


def test_every_frame_of_treadmill_walking_counts(whole):
    assert free_of(whole.quality, Quality.POSE_UNKNOWN).all()
    assert free_of(whole.quality, NO_SUPPORT).all()
    settled = free_of(whole.quality, Quality.SETTLING)
    assert settled[17:-17].all()
    assert not settled[:17].any()
    assert not settled[-17:].any()
    assert {side: len(spans) for side, spans in whole.cycles.items()} == {"right": 10}
    assert whole.found_cycles == 10
    assert not {"frames_not_carried", "cycles_left_out"} & set(codes(whole))


@pytest.fixture(scope="module")
def beside(treadmill):
    """The walk with a plate that misses the steps from 5.6 to 9 s."""
    return again(with_plates(treadmill, without(2, 5.6, 9.0)))


def test_while_a_foot_is_beside_the_plates_nothing_counts_and_all_else_as_before(whole, beside):
    result = beside
    valid, time = free_of(result.quality, NO_SUPPORT), result.motion.time
    hidden = np.abs(result.measured.residual - whole.measured.residual)[:, 2] > 0.5 * 55.3 * 9.81
    assert hidden.any()
    assert not valid[hidden].any()
    assert valid[(time < 5.3) | (time > 9.3)].all()
    difference = np.abs(result.measured.residual - whole.measured.residual)[valid]
    assert (difference.max(axis=0) < [2, 2, 2, 1, 1, 1]).all()
    assert "frames_not_carried" in codes(result)
    (note,) = [note for note in result.notes if note.code == "cycles_left_out"]
    assert "do not carry" in note.values["reasons"]
    assert result.found_cycles == 10


def test_forces_that_depend_on_missing_plates_are_in_no_output(whole, beside, tmp_path):
    """Of pelvis and legs; those of the trunk do not depend on the ground."""
    result = beside
    valid = result.counts
    for name in ("LHipFlexion", "RKneeFlexion"):
        known = np.isfinite(result.measured.force(name))
        np.testing.assert_array_equal(
            known, valid & free_of(result.quality, Quality.FOOT_UNCERTAIN)
        )
    np.testing.assert_allclose(
        result.measured.force("TrunkFlexion"), whole.measured.force("TrunkFlexion"), atol=1e-9
    )
    write_tables(result, tmp_path, "walk")
    table = read_sto(tmp_path / "walk_forces.sto")
    for column in ("PelvisZ_force", "PelvisYaw_moment"):
        np.testing.assert_array_equal(np.isfinite(table.columns[column]), valid)


def test_plates_that_begin_late_do_not_count_before(treadmill, whole):
    result = again(with_plates(treadmill, lambda p: p.time > 5.0))
    assert not result.counts[result.motion.time < 5.0].any()
    assert rms(result, "Fz") == pytest.approx(rms(whole, "Fz"), rel=0.15)
    assert min(spans[0, 0] for spans in result.cycles.values()) > 4.0


def test_where_a_plate_is_dead_there_are_no_residuals_and_a_warning_says_so(treadmill):
    result = again(with_plates(treadmill, lambda p: float(p.number == 1)))
    assert not any(map(len, result.cycles.values()))
    assert residual_table(result, "walk").empty
    (note,) = [note for note in result.notes if note.code == "no_residuals"]
    assert note.level == "warning"
    assert "20 for plates" in note.text
    assert "mass_differs" not in codes(result)


def test_plates_that_are_not_zeroed_are_not_hidden(treadmill):
    def shifted(plate):
        normal = plate.rotation.T @ [0, 0, (-150, 0)[plate.number - 1]]
        return replace(plate, wrench_in_plate=plate.wrench_in_plate + np.append(normal, [0, 0, 0]))

    result = again(replace(treadmill, plates=tuple(map(shifted, treadmill.plates))))
    assert free_of(result.quality, NO_SUPPORT).all()
    assert sum(map(len, result.cycles.values())) == 10
    assert "plates_not_zeroed" in codes(result)


def test_a_plate_with_a_wrong_gain_is_not_hidden(treadmill):
    """Its residual is what the report is for."""
    result = again(with_plates(treadmill, lambda p: (1.0, 1.3)[p.number - 1]))
    assert free_of(result.quality, NO_SUPPORT).all()
    assert sum(map(len, result.cycles.values())) == 10
    assert rms(result, "Fz") > 80
    vertical = [
        n.values for n in result.notes if n.code == "plate_gain" and n.values["component"] == "Fz"
    ]
    assert [values["plate"] for values in vertical] == [2]
    assert vertical[0]["low"] < 1.3 < vertical[0]["high"]


def test_of_a_walk_over_two_plates_the_stride_on_them_counts(shared_data):
    """The left foot's has its second half beside the plates, and nothing of it is asked for.

    The file states no mass: 72 kg are some 9 kg too much, which is 90 N of every residual.
    """
    result = recorded.processed(recorded.two_plates, shared_data)
    assert {side: len(spans) for side, spans in result.cycles.items()} == {"right": 1}
    assert result.found_cycles == 1
    assert not [note for note in result.notes if note.code == "cycles_left_out"]
    table = residual_table(result, "walk").set_index("axis")
    assert 0.5 < table.loc["Fz", "valid_share"] < 1
    assert table.loc["Fz", "peak"] < 150
    assert table.loc["Fz", "sd"] < 30
    everything = np.abs(result.measured.residual[:, 2])
    assert np.nanmax(everything) > 600


def test_quiet_standing_has_residuals_and_weighs_the_subject(shared_data, tmp_path, capsys):
    path = shared_data / "full_body_standing" / "1min_CGM_HBM_static.c3d"
    assert main(["residuals", str(path), "--verbose", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "0.17–5.53 s" in printed
    assert "no foot strikes" in printed
    result = read_trial(tmp_path / f"{path.stem}.parquet")
    recording = read_c3d(path)
    vertical = sum(plate.wrench[:, 2] for plate in recording.plates)
    assert result.body.mass == pytest.approx(np.mean(vertical) / GRAVITY_MPS2, rel=0.005)
    table = residual_table(result, "standing").set_index("axis")
    assert (table.loc[["Fx", "Fy", "Fz"], "rms_percent"] < 1).all()
    assert table["rms"].notna().all()
    assert set(table["window"]) == {"span"}
    assert (table["valid_share"] == 1).all()


def test_nobody_counts_who_stands_with_one_foot_beside_the_plates(shared_data):
    recording = read_c3d(shared_data / "full_body_standing" / "1min_CGM_HBM_static.c3d")
    total = sum(plate.wrench[:, 2] for plate in recording.plates)
    only = recording.plates[0]
    factor = 0.75 * total / only.wrench[:, 2]
    one = replace(only, wrench_in_plate=only.wrench_in_plate * factor[:, None])
    zero = replace(recording.plates[1], wrench_in_plate=0 * recording.plates[1].wrench_in_plate)
    subject = Subject(mass_kg=float(total.mean()) / GRAVITY_MPS2)
    result = process_recording(replace(recording, plates=(one, zero)), subject, Settings())
    assert not free_of(result.quality, NO_SUPPORT).any()


def without_markers(recording, body, segments, start_s, stop_s):
    """The recording with gaps in all markers of some segments."""
    gone = [m for m, s in body.segment_of.items() if s in segments]
    time = recording.markers.time
    rows = (time >= start_s) & (time < stop_s)
    return replace(recording, markers=motions.without(recording.markers, gone, rows))


@pytest.mark.parametrize(("stop_s", "counts"), [(5.06, True), (5.5, False)])
def test_a_pelvis_without_markers_counts_for_a_few_frames_only(treadmill, whole, stop_s, counts):
    result = again(without_markers(treadmill, whole.body, ("pelvis",), 5.0, stop_s))
    gap = (result.motion.time > 5.0) & (result.motion.time < stop_s - 0.005)
    assert result.motion.converged.all()
    assert free_of(result.quality, Quality.POSE_UNKNOWN)[~gap].sum() >= (~gap).sum() - 2
    assert free_of(result.quality, Quality.POSE_UNKNOWN)[gap].all() == counts
    assert ("pelvis_unseen" in codes(result)) != counts


@pytest.fixture(scope="module")
def overground(shared_data):
    walk, known = recorded.recorded(recorded.child("HC030"), shared_data)
    return walk, known["static"]


def half_beside(walk):
    """The walk with a plate that ends at its middle and measures half as much."""
    first, second = walk.plates
    corners = second.corners.copy()
    corners[:, 0] = (corners[:, 0] + corners[:, 0].max()) / 2 + 0.02
    second = replace(second, corners=corners, wrench_in_plate=second.wrench_in_plate / 2)
    return replace(walk, plates=(first, second))


def test_which_frames_count_does_not_depend_on_the_body_mass(overground):
    walk, static = overground
    found = [
        process_recording(half_beside(walk), Subject(mass_kg=mass_kg), Settings(), static=static)
        for mass_kg in (41.3, 50.4)
    ]
    plates = np.array([free_of(result.quality, NO_SUPPORT) for result in found])
    assert plates.any()
    assert (plates == plates[0]).all()


def test_overground_the_same_frames_count_live_as_afterwards(overground):
    walk, static = overground
    settings = Settings(filter="realtime")
    result = process_recording(walk, Subject(), settings, static=static)
    frames = play(chain_of(result.body, Laboratory(Treadmill()), settings, walk), arrivals(walk))
    counts = np.array([frame.quality.counts for frame in frames])
    np.testing.assert_array_equal(counts[:-5], result.counts[:-5])
    vertical = np.array([frame.residual["measured"][2] for frame in frames])
    assert np.sqrt(np.mean(vertical[counts] ** 2)) < 30
    assert any(frame.quality & Quality.NOT_CARRIED for frame in frames)
