"""A rewritten file is the original but for its plates' samples, one group and the data's start."""

import struct
import tracemalloc
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pipeline.export.compensated_c3d import check_rewritten, rewrite_plates
from pipeline.io.c3d.data import analog_scaling, read_header, read_samples
from pipeline.io.c3d.force_plates import plate_layouts
from pipeline.io.c3d.parameters import (
    parameter_records,
    values_of,
    with_values,
)
from pipeline.io.c3d.read import GROUP, read_compensation
from pipeline.io.c3d.second_reader import SecondReading, installed
from pipeline.io.read_options import ReadOptions
from pipeline.io.recording import Compensation
from tests.pipeline.io.c3d.plate_files import BLOCK, CORNERS_MM, PlateFile

DONE = Compensation("hbm-residuals 0.2.0", (1, 2), "lab.json", "ab" * 32, cutoff_hz=20.0)
TYPES, PROCESSORS = (2, 3, 4), ("intel", "dec", "sgi")
CHANGE = np.array([3.0, -2.0, 5.0, 1.0, -2.0, 0.5])
"""Amplitude of the change of a wrench [N, N·m]."""
REAL_FILES = (
    "c3d_samples/DEC_INT.C3D",
    "c3d_samples/TYPE-4.C3D",
    "c3d_samples/sgi_real.c3d",
    "overground_walks/HC030A05.c3d",
    "plug_in_gait/Movement_trial.c3d",
    "treadmill_hbm2/treadmill_events.c3d",
)


def plates_of(path):
    """Wrenches of a file's plates, without the axes that a recording needs."""
    header = read_header(path)
    samples = read_samples(header)
    plates, _ = plate_layouts(header, ReadOptions())
    return [plate.wrench(samples.analog[:, plate.channels]) for plate in plates]


def changes_of(path, size=1.0):
    """A smooth change of every plate's wrench, other than zero in every sample."""
    changes = []
    for k, plate in enumerate(plates_of(path), 1):
        phase = np.linspace(0.1, 3.0, len(plate))
        changes.append(size * CHANGE * np.sin(k * phase)[:, None])
    return changes


def rewritten(path, changes, **options):
    target = path.parent / "written" / path.name
    return target, rewrite_plates(path, target, changes, DONE, **options)


def original_of(shared_data, tmp_path, name):
    copy = tmp_path / Path(name).name
    copy.write_bytes((shared_data / name).read_bytes())
    return copy


def unchanged(path):
    return [np.zeros_like(plate) for plate in plates_of(path)]


def assert_only_the_group_is_added(original, written):
    """Every byte but those of the added group and of the data's start is the original's.

    Free are also the length of the section, and the way from its last record on.
    """
    before, after = map(read_header, (original, written))
    first, second = bytearray(original.read_bytes()), bytearray(written.read_bytes())
    assert second[after.data_start :] == first[before.data_start :]
    start = (before.parameter_block - 1) * BLOCK
    records = list(
        parameter_records(bytes(first[start + 4 : before.data_start]), before.byte_order)
    )
    last = start + 4 + records[-1].pointer
    free = [16, 17, start, start + 1, start + 2, last, last + 1]
    for record in records:
        if record.name == "DATA_START":
            at = start + 4 + values_of(bytes(first[start + 4 :]), record)[2].start
            free += [at, at + 1]
    for k in free:
        first[k] = second[k] = 0
    assert second[:last] == first[:last]
    assert read_compensation(after.parameters) == DONE


def assert_read_back(original, written, changes):
    """Real samples: to 1e-6 of the largest component. Whole ones: half a count in every channel."""
    header = read_header(original)
    _, scale, _ = analog_scaling(header)
    for plate, before, after, change in zip(
        plate_layouts(header, ReadOptions())[0],
        plates_of(original),
        plates_of(written),
        changes,
        strict=True,
    ):
        wanted = before + change
        error = np.abs(after - wanted)
        if header.scale < 0:
            assert (error <= 1e-6 * np.abs(wanted).max(axis=0)).all()
            continue
        half = np.abs(scale[list(plate.channels)]) / 2
        to_wrench = np.abs(plate.wrench(np.eye(len(half))).T)
        assert (error <= 1.000001 * to_wrench @ half).all()


@pytest.fixture
def without_second_reader(monkeypatch):
    """Save the seconds that it takes where a test compares the bytes itself."""
    nobody = SecondReading("ezc3d", "not asked")
    monkeypatch.setattr("pipeline.export.compensated_c3d.check_rewritten", lambda *_, **__: nobody)


@pytest.mark.usefixtures("without_second_reader")
@pytest.mark.parametrize(
    ("kind", "byte_order", "real", "last_step"),
    [
        (2, "intel", True, "zero"),
        (2, "dec", False, "stated"),
        (3, "sgi", True, "stated"),
        (4, "intel", False, "zero"),
        (2, "sgi", True, "zero"),
        (4, "dec", True, "stated"),
    ],
)
def test_without_a_change_only_the_group_is_added(tmp_path, kind, byte_order, real, last_step):
    file = PlateFile(kind, byte_order, real, plates=2, last_step=last_step)
    original = file.write(tmp_path / "trial.c3d")
    written, _ = rewritten(original, unchanged(original))
    assert_only_the_group_is_added(original, written)


@pytest.mark.parametrize("name", REAL_FILES)
def test_a_real_file_reads_back_as_the_changed_wrench(shared_data, tmp_path, name):
    original = original_of(shared_data, tmp_path, name)
    changes = changes_of(original)
    written, verification = rewritten(original, changes)
    assert_read_back(original, written, changes)
    assert bool(verification.refusal) == (name == "c3d_samples/sgi_real.c3d" or not installed())


@pytest.mark.usefixtures("without_second_reader")
@given(
    st.builds(
        PlateFile,
        kind=st.sampled_from(TYPES),
        byte_order=st.sampled_from(PROCESSORS),
        real=st.booleans(),
        unsigned=st.booleans(),
        plates=st.integers(1, 3),
        per_frame=st.integers(1, 5),
        general_scale=st.sampled_from([1.0, 0.25, 3.0]),
        spare_channels=st.integers(0, 2),
        offset=st.sampled_from([0, 3]),
    )
)
@settings(
    max_examples=30,
    deadline=timedelta(seconds=5),
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
def test_a_changed_wrench_is_read_back_whatever_the_file(tmp_path, file):
    if file.unsigned and not file.real:
        file.offset = 30_000
    original = file.write(tmp_path / "trial.c3d")
    changes = changes_of(original)
    (tmp_path / "written" / "trial.c3d").unlink(missing_ok=True)
    written, _ = rewritten(original, changes)
    assert_read_back(original, written, changes)
    header = read_header(written)
    spare = read_samples(header).analog[:, : file.spare_channels]
    before = read_samples(read_header(original)).analog[:, : file.spare_channels]
    np.testing.assert_array_equal(spare, before)


def test_a_file_is_not_compensated_twice(tmp_path):
    original = PlateFile(2).write(tmp_path / "trial.c3d")
    written, _ = rewritten(original, changes_of(original))
    with pytest.raises(ValueError, match=r"^trial\.c3d: .*compensated already"):
        rewrite_plates(written, tmp_path / "again.c3d", changes_of(written), DONE)
    assert not (tmp_path / "again.c3d").exists()


@pytest.mark.parametrize("unsigned", [False, True])
def test_a_sample_that_would_saturate_is_named(tmp_path, unsigned):
    file = PlateFile(2, real=False, unsigned=unsigned, offset=30_000 * unsigned)
    original = file.write(tmp_path / "trial.c3d")
    changes = unchanged(original)
    changes[0][57, 2] = 8000.0  # N, as many as 50,000 counts
    with pytest.raises(ValueError, match=r"plate 1, .*P1C3, .*0\.1425 s: "):
        rewritten(original, changes)
    assert list((tmp_path / "written").iterdir()) == []


def test_plates_of_type_1_are_refused(tmp_path):
    """They store a centre of pressure, which a compensated force need not have."""
    original = PlateFile(1).write(tmp_path / "trial.c3d")
    with pytest.raises(ValueError, match=r"^trial\.c3d: .*plate 1: .*centre"):
        rewritten(original, unchanged(original))


def test_samples_that_are_no_number_stay_so(tmp_path):
    file = PlateFile(2)
    file.values[10:14, 3] = np.nan
    original = file.write(tmp_path / "trial.c3d")
    changes = changes_of(original)
    written, _ = rewritten(original, changes)
    (before,), (after,) = plates_of(original), plates_of(written)
    assert np.isnan(after[10:14]).any(axis=1).all()
    known = np.isfinite(before).all(axis=1)
    wanted = (before + changes[0])[known]
    np.testing.assert_allclose(after[known], wanted, atol=1e-3)


def room_of(path):
    """Bytes that are free in the last block of parameters."""
    section = path.read_bytes()[BLOCK : read_header(path).data_start]
    last = list(parameter_records(section[4:], "intel"))[-1]
    return -(4 + last.pointer + last.step) % BLOCK


def test_a_parameter_section_without_room_grows_by_whole_blocks(tmp_path):
    files = (PlateFile(2, spare_channels=n).write(tmp_path / "t.c3d") for n in range(40))
    original = next(path for path in files if room_of(path) < 60)
    written, _ = rewritten(original, unchanged(original))
    assert_only_the_group_is_added(original, written)
    assert read_header(written).data_block == read_header(original).data_block + 1


@pytest.mark.slow
@pytest.mark.usefixtures("without_second_reader")
def test_a_long_trial_is_written_whole_in_the_memory_of_a_short_one(tmp_path):
    """More frames than 16 bits can count."""
    peaks = {}
    for frames in (10_000, 70_000):
        original = PlateFile(2, frames=frames).write(tmp_path / f"{frames}.c3d")
        changes = changes_of(original)
        tracemalloc.start()
        written, _ = rewritten(original, changes)
        peaks[frames] = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert_read_back(original, written, changes)
        assert len(plates_of(written)[0]) == 4 * frames
    assert peaks[70_000] < 1.2 * peaks[10_000]


def test_another_file_at_the_target_is_kept(tmp_path):
    original = PlateFile(2).write(tmp_path / "trial.c3d")
    target = tmp_path / "other.c3d"
    target.write_bytes(b"mine")
    with pytest.raises(ValueError, match=r"other\.c3d .*another file"):
        rewrite_plates(original, target, changes_of(original), DONE)
    assert target.read_bytes() == b"mine"
    first, _ = rewritten(original, changes_of(original))
    content = first.read_bytes()
    rewritten(original, changes_of(original))  # the same again is no other file
    assert first.read_bytes() == content


def test_what_follows_the_last_parameter_may_be_anything(tmp_path):
    """Programs that state a wrong way from the last record on leave old bytes behind it."""
    original = PlateFile(2).write(tmp_path / "trial.c3d")
    content, header = bytearray(original.read_bytes()), read_header(original)
    start, data = ((block - 1) * BLOCK for block in (header.parameter_block, header.data_block))
    last = list(parameter_records(bytes(content[start + 4 : data]), "intel"))[-1]
    end, pointer = start + 4 + last.pointer + last.step, start + 4 + last.pointer
    struct.pack_into("<h", content, pointer, 16129)
    content[end + 2 : data] = b"\x41" * (data - end - 2)
    original.write_bytes(content)
    written, _ = rewritten(original, unchanged(original))
    assert written.read_bytes()[-len(content) + data :] == content[data:]
    assert read_header(written).parameters.text(GROUP, "SOFTWARE") == DONE.software


@pytest.mark.parametrize("wrong", [np.nan, 1e-38])
def test_a_channel_of_a_scale_that_is_no_number_is_refused(tmp_path, wrong):
    """As it is where a damaged byte made the scale so: no sample can be computed from it."""
    file = PlateFile(2, real=False)
    original = file.write(tmp_path / "trial.c3d")
    changes, scale = changes_of(original), struct.pack("<f", file.scale[3])
    content = original.read_bytes()
    assert content.count(scale) >= 1
    original.write_bytes(content.replace(scale, struct.pack("<f", wrong)))
    with pytest.raises(ValueError, match=r"^trial\.c3d: "):
        rewritten(original, changes)
    assert not list((tmp_path / "written").glob("*"))


def test_a_plate_that_is_left_out_keeps_its_samples_and_corners(tmp_path):
    """Of two plates the first one has a type that is unknown: the second is the one that moves."""
    original = PlateFile(2, plates=2).write(tmp_path / "trial.c3d")
    header = read_header(original)
    content = original.read_bytes()
    start = BLOCK * (header.parameter_block - 1)
    section = content[start : header.data_start]
    section = with_values(section, "intel", "FORCE_PLATFORM", "TYPE", np.array([5, 2]))
    original.write_bytes(content[:start] + section + content[header.data_start :])
    (layout,) = plate_layouts(read_header(original), ReadOptions())[0]
    assert layout.number == 2
    corners = (layout.corners - layout.corners.mean(axis=0)) @ layout.rotation + [0, 0, 0.05]

    changes = changes_of(original)
    target = tmp_path / "written" / original.name
    rewrite_plates(original, target, changes, DONE, [corners])
    (moved,) = plate_layouts(read_header(target), ReadOptions())[0]
    np.testing.assert_allclose(
        moved.corners, layout.corners + 0.05 * layout.rotation[:, 2], atol=1e-7
    )
    first, second = (read_header(path).parameters for path in (original, target))
    before, after = (each.numbers("FORCE_PLATFORM", "CORNERS")[..., 0] for each in (first, second))
    np.testing.assert_array_equal(before, after)
    samples = [read_samples(read_header(path)).analog for path in (original, target)]
    np.testing.assert_array_equal(samples[0][:, :7], samples[1][:, :7])
    np.testing.assert_allclose(plates_of(target)[0], plates_of(original)[0] + changes[0], atol=1e-3)


def test_corners_in_another_unit_are_moved_in_it(tmp_path):
    """In cm, which a marker above the plate shows; the file is in mm."""
    original, above = PlateFile(2).write(tmp_path / "trial.c3d"), np.zeros((30, 1, 3))
    header, content = read_header(original), original.read_bytes()
    start, numbers = BLOCK * (header.parameter_block - 1), CORNERS_MM.T[..., None] / 10
    section = content[start : header.data_start]
    section = with_values(section, "intel", "FORCE_PLATFORM", "CORNERS", numbers)
    original.write_bytes(content[:start] + section + content[header.data_start :])
    (plate,) = plate_layouts(read_header(original), ReadOptions(), above)[0]
    np.testing.assert_allclose(np.ptp(plate.corners, axis=0), [0.6, 0.4, 0], atol=1e-7)
    corners = (plate.corners - plate.corners.mean(axis=0)) @ plate.rotation + [0, 0, 0.05]
    target = tmp_path / "written" / original.name
    rewrite_plates(original, target, changes_of(original), DONE, [corners], position=above)
    (moved,) = plate_layouts(read_header(target), ReadOptions(), above)[0]
    np.testing.assert_allclose(
        moved.corners, plate.corners + 0.05 * plate.rotation[:, 2], atol=1e-7
    )


def test_a_channel_that_two_plates_share_is_refused(tmp_path):
    original = PlateFile(2, plates=2).write(tmp_path / "trial.c3d")
    content = original.read_bytes()
    channels = struct.pack("<12H", *range(2, 14))
    assert channels in content
    shared = struct.pack("<12H", *range(2, 8), 2, *range(9, 14))
    original.write_bytes(content.replace(channels, shared))
    with pytest.raises(ValueError, match=r"FORCE_PLATFORM:CHANNEL .*P1C1 twice"):
        rewritten(original, changes_of(original))


def copied(original, change):
    """Copy a file and change its bytes, given them and where the data begin."""
    header = read_header(original)
    content = bytearray(original.read_bytes())
    change(content, header.data_start, header.frame.bytes)
    path = original.with_name("written.c3d")
    path.write_bytes(content)
    return path


def test_what_was_to_change_may_differ(everything):
    def a_bit(content, start, size):
        content[start + 3 * size + 4 * (20 + 8 + 6)] ^= 1

    for change in (lambda *_: None, a_bit):
        found = check_rewritten(everything, copied(everything, change), changed_channels=(6,))
        assert bool(found.refusal) != installed()

    def later(content, *_):
        at = content.index(struct.pack("<f", 0.05))
        content[at : at + 4] = struct.pack("<f", 0.06)

    written = copied(everything, later)
    check_rewritten(everything, written, changed_channels=(), changed_parameters=["EVENT:TIMES"])
    with pytest.raises(ValueError, match=r"parameter EVENT:TIMES differs$"):
        check_rewritten(everything, written, changed_channels=())


@given(place=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
@settings(max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_no_bit_of_header_and_samples_may_change(everything, place, bit):
    """Free are bytes 17 and 18, which say where the data begin."""
    header = read_header(everything)
    size = everything.stat().st_size - header.data_start
    at = int(place * (BLOCK + size))
    at = at if at < BLOCK else at - BLOCK + header.data_start
    if at in (16, 17):
        return
    written = copied(everything, lambda c, *_: c.__setitem__(at, c[at] ^ (1 << bit)))
    with pytest.raises(ValueError, match=r"^the copy is") as caught:
        check_rewritten(everything, written, changed_channels=())
    assert "\n" not in str(caught.value)
