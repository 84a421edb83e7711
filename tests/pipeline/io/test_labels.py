"""Labels with prefixes, that occur twice or are exchanged are settled alike in every format."""

import re
import shlex
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hbm.markers import Markers, marker_sets
from pipeline.io.columns import settle_markers
from pipeline.io.labels import without_prefixes
from pipeline.io.read import read_recording
from pipeline.io.read_options import ReadOptions
from pipeline.io.recording import Analog
from pipeline.io.units import length_in_m
from pipeline.virtual_lab.machine.c3d_file import write_c3d
from tests.pipeline import xdf_file
from tests.pipeline.other_formats import excerpt, write_dflow, write_mox, write_nexus, write_opensim
from tests.synthetic import synthetic_t_pose

POSE = synthetic_t_pose()
NOISY = POSE.position + np.random.default_rng(1).normal(scale=1e-3, size=POSE.position.shape)
FRAMES = len(NOISY)
STAND_IN = "LPSIQ"
"""A label that becomes LPSIS in the file."""


AXES = "forward,left,up"


@pytest.fixture(scope="module")
def trial(walker):
    return excerpt(walker, 400, 500)


WRITERS = {
    "C3D": lambda trial, path: write_c3d(path, trial.markers, trial.plates, axes=AXES),
    "TRC": lambda trial, path: write_opensim(trial, path, path.with_suffix(".mot")),
    "D-Flow": write_dflow,
    "MOX": write_mox,
    "Nexus": write_nexus,
    "XDF": lambda trial, path: xdf_file.write_xdf(path, xdf_file.recorded(trial)),
}


def with_second(trial, position, path, name):
    """Write a trial, (T, M, 3), whose last trajectory has the label of its third one."""
    names = (*trial.markers.names, STAND_IN)
    WRITERS[name](
        replace(trial, markers=replace(trial.markers, names=names, position=position)), path
    )
    path.write_bytes(path.read_bytes().replace(STAND_IN.encode(), b"LPSIS"))
    return path


def kinds(recording):
    return [fact.kind for fact in recording.facts if fact.kind != "left_out"]


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("first_frames", [0, 40, 100])
def test_trajectories_of_one_label_that_are_never_seen_at_once_are_one(
    trial, tmp_path, name, first_frames
):
    k = trial.markers.names.index("LPSIS")
    position = np.concatenate([trial.markers.position, trial.markers.position[:, [k]]], axis=1)
    position[first_frames:, k] = np.nan
    position[:first_frames, -1] = np.nan
    read = read_recording(with_second(trial, position, tmp_path / "a.dat", name))
    assert read.markers.names == trial.markers.names
    np.testing.assert_allclose(read.markers.position, trial.markers.position, atol=2e-6)
    joined = [fact for fact in read.facts if fact.kind == "joined"]
    assert len(joined) == 1
    assert joined[0].of == "marker LPSIS"
    shown = "never seen" if first_frames in (0, 100) else "frames 1–40"
    assert f"trajectories {k + 1} (" in joined[0].reason
    assert shown in joined[0].reason


@pytest.mark.parametrize("name", WRITERS)
def test_trajectories_of_one_label_in_two_places_are_a_doubt_with_options_that_name_them_apart(
    trial, tmp_path, name
):
    k = trial.markers.names.index("LPSIS")
    true = trial.markers.position[:, [k]]
    position = np.concatenate([trial.markers.position, true], axis=1)
    position[:, k] += [0.0, 0.0, 0.072]
    path = with_second(trial, position, tmp_path / "a.dat", name)
    (doubt,) = (fact for fact in read_recording(path).facts if fact.kind == "in_doubt")
    assert f"trajectories {k + 1} and {position.shape[1]} " in doubt.reason
    assert "72 mm" in doubt.reason
    read = read_recording(path, ReadOptions(rename=renames(doubt.reason)))
    found = read.markers.position[:, read.markers.names.index("LPSIS")]
    np.testing.assert_allclose(found, true[:, 0], atol=2e-6)


def renames(text):
    """What the options in a message rename, as a shell and the command line read them."""
    options = re.findall(r"--rename ('[^']*'|[^\s,;)]+)", text)
    return dict(shlex.split(option)[0].split("=") for option in options)


@pytest.mark.parametrize(("twin", "doubts"), [([], 1), (["LANK"], 0)])
def test_a_second_label_that_a_marker_set_has_on_both_sides_is_a_doubt_where_one_side_has_it(
    twin, doubts
):
    labels = ["LANK", "RANK", "RANK", *twin]
    position = np.arange(30.0 * len(labels)).reshape(10, -1, 3) / 100
    found = settled(labels, position)
    assert [fact.of for fact in found.notes] == ["marker RANK"] * doubts


def settled(labels, position, **stated):
    wanted = dict(enumerate(labels))
    return settle_markers(wanted, "m", np.array(position), ReadOptions(**stated), ())


@given(data=st.data())
@settings(deadline=None, max_examples=40)
def test_however_a_trajectory_is_cut_and_relabelled_the_marker_is_whole(data):
    """Pieces in any order, spelt in any case, that may overlap with copies rounded to 0.1 mm."""
    column = data.draw(st.integers(0, len(POSE.names) - 1))
    cuts = data.draw(st.lists(st.integers(0, FRAMES), min_size=1, max_size=3).map(sorted))
    overlap = data.draw(st.integers(0, 5))
    name = POSE.names[column]
    pieces, labels = [], []
    for start, stop in zip([0, *cuts], [*cuts, FRAMES], strict=True):
        piece = np.full((FRAMES, 3), np.nan)
        piece[max(0, start - overlap) : stop] = np.round(NOISY, 4)[
            max(0, start - overlap) : stop, column
        ]
        pieces.append(piece)
        labels.append(data.draw(st.sampled_from([name, name.lower(), f"{name[:1]} {name[1:]}"])))
    others = [k for k in range(len(POSE.names)) if k != column]
    position = np.concatenate([NOISY[:, others], np.stack(pieces, axis=1)], axis=1)
    names = [POSE.names[k] for k in others] + labels
    order = data.draw(st.permutations(range(len(names))))
    found = settled([names[k] for k in order], position[:, order])
    (its,) = (k for k, n in enumerate(found.names) if n.replace(" ", "").upper() == name)
    np.testing.assert_allclose(found.position[:, its], NOISY[:, column], atol=2e-4)
    assert len(found.names) == len(POSE.names)
    assert [fact.kind for fact in found.notes] == ["joined"]


def test_unlabelled_trajectories_are_neither_joined_nor_doubted():
    labels = [*POSE.names, "*", "*", "*12", "U 3", "U 3", "Unlabelled"]
    position = np.concatenate([NOISY, NOISY[:, :6]], axis=1)
    position[: FRAMES // 2, -6] = np.nan
    position[FRAMES // 2 :, -5] = np.nan
    found = settled(labels, position)
    assert len(found.names) == len(labels)
    assert found.notes == []


def test_two_labels_that_a_marker_set_numbers_are_no_doubt():
    """Lateral and medial knee markers of four letters, as in files of Motion Analysis."""
    labels = [*POSE.names, "LKNE", "LKNE"]
    position = np.concatenate([NOISY, NOISY[:, :2]], axis=1)
    assert settled(labels, position).notes == []


CODES = st.one_of(
    st.sampled_from([9999.0, -9999.0, 999.9, -1.0, 99999.0, -3.697314e28, 1e35, -99.0]),
    st.floats(-1e30, 1e30).filter(lambda code: code != 0),
)


@given(
    code=CODES,
    share=st.sampled_from([0.05, 0.4, 0.8]),
    one_marker=st.booleans(),
    seed=st.integers(0, 99),
)
@settings(deadline=None, max_examples=60)
def test_one_number_in_all_axes_is_a_gap_and_nothing_else_is(code, share, one_marker, seed):
    """In mm, in few samples or most, of one marker or all."""
    rng = np.random.default_rng(seed)
    position = 1000 * NOISY
    missing = rng.random(position.shape[:2]) < share
    missing[:2, 3] = True
    if one_marker:
        missing[:, np.arange(len(POSE.names)) != 3] = False
    position[missing] = code
    found = settle_markers(dict(enumerate(POSE.names)), "mm", position, ReadOptions(), ())
    np.testing.assert_array_equal(np.isnan(found.position[..., 0]), missing)
    np.testing.assert_allclose(found.position[~missing], NOISY[~missing], atol=1e-12)
    (fact,) = found.notes
    assert fact.kind == "missing"
    assert f" at {np.float64(code):.7g} " in fact.reason


@pytest.mark.parametrize("name", WRITERS)
def test_codes_of_missing_samples_are_gaps_in_every_format(trial, tmp_path, name):
    position = trial.markers.position.copy()
    position[20:50, 3] = 9.999
    position[70:72, 4] = 9.999
    path = tmp_path / "a.dat"
    axes = AXES if name in ("C3D", "XDF") else None
    WRITERS[name](replace(trial, markers=replace(trial.markers, position=position)), path)
    if name not in ("C3D", "XDF"):  # written in axes with other signs
        text = path.read_text(encoding="utf-8")
        path.write_text(re.sub(r"-(9999|9\.999)(0*)\b", r"\1\2", text), encoding="utf-8")
    read = read_recording(path, axes)
    gaps = np.isnan(read.markers.position[..., 0]) & np.isfinite(trial.markers.position[..., 0])
    assert np.unique(np.argwhere(gaps)[:, 1]).tolist() == [3, 4]
    assert gaps.sum() == 32
    assert "missing" in kinds(read)


@given(column=st.integers(0, len(POSE.names) - 1), frame=st.integers(0, FRAMES - 1))
@settings(deadline=None, max_examples=20)
def test_a_marker_on_the_diagonal_of_the_axes_is_a_marker(column, frame):
    """Once by chance, or throughout because it rests there."""
    position = NOISY.copy()
    position[frame, column] = position[frame, column, 2]
    position[:, (column + 1) % len(POSE.names)] = 0.7 + (np.arange(FRAMES) % 3)[:, None] * 1e-4
    found = settled(POSE.names, position)
    np.testing.assert_array_equal(found.position, position)
    assert found.notes == []


@pytest.mark.parametrize(("factor", "unit"), [(100.0, "cm"), (1000.0, "mm")])
def test_a_wrong_unit_is_named_with_the_right_one_beside_codes_of_missing_samples(factor, unit):
    position = factor * NOISY
    position[:5, 2] = 9999.0
    with pytest.raises(ValueError, match=rf" m in {unit}: .*--units {unit},"):
        settled(POSE.names, position)


@pytest.mark.parametrize(
    ("factor", "written", "unit"), [(10.0, "cm", "mm"), (0.1, "mm", "cm"), (0.1, "m", "no unit")]
)
@pytest.mark.parametrize("size", [0.4, 1.0, 1.25])
def test_a_child_or_a_tall_person_of_ten_times_or_a_tenth_the_size_is_in_another_unit(
    factor, written, unit, size
):
    position = NOISY * size * factor / length_in_m(written)
    with pytest.raises(ValueError, match=rf"(markers spread|pelvis or shoulders) .*{unit}"):
        settle_markers(dict(enumerate(POSE.names)), written, position, ReadOptions(), ())


PREFIXES = st.text("ABCDEFGHJKMNQVWXYZabcdefgh0123456789", min_size=1, max_size=8)
SEPARATORS = st.sampled_from(["_", "-", " ", ".", ":", "", " - ", "__"])


@given(
    prefix=PREFIXES,
    separator=SEPARATORS,
    name=st.sampled_from(sorted(set(marker_sets()) - {"coda"})),
    others=st.integers(0, 4),
)
@settings(deadline=None, max_examples=100)
def test_a_beginning_that_all_labels_share_is_removed_and_never_shown(
    prefix, separator, name, others
):
    """A platform's markers may lack it; the option takes it with and without separator."""
    bare = [*marker_sets()[name].segment]
    platform = [f"PLAT{k}" for k in range(others)]
    labels = [*(prefix + separator + label for label in bare), *platform]
    found, said = without_prefixes(labels, ReadOptions())
    assert [*found.values()] == [*bare, *platform]
    assert all(prefix not in str(each).split() for each in said)
    for stated in (prefix + separator, prefix, "1"):
        if stated.strip():
            found, _ = without_prefixes(labels, ReadOptions(label_prefix=stated))
            assert [*found.values()] == [*bare, *platform]


@given(separator=st.sampled_from(["_", "-", " ", ":"]), number=st.sampled_from(["1", "2"]))
@settings(deadline=None, max_examples=10)
def test_of_two_subjects_one_is_chosen_by_any_prefix(separator, number):
    bare = [*marker_sets()["pig_lower"].segment]
    labels = [f"{who}{separator}{label}" for who in ("Anna", "Boris") for label in bare]
    with pytest.raises(ValueError, match=r"2 subjects .* \(1, 2\)") as several:
        without_prefixes(labels, ReadOptions())
    assert "Anna" not in str(several.value)
    found, _ = without_prefixes(labels, ReadOptions(label_prefix=number))
    assert [*found.values()] == bare
    assert min(found) == len(bare) * (int(number) - 1)


@given(name=st.sampled_from(sorted(marker_sets())))
@settings(deadline=None, max_examples=20)
def test_labels_of_a_set_have_no_prefix(name):
    labels = [*marker_sets()[name].segment]
    found, said = without_prefixes(labels, ReadOptions())
    assert [*found.values()] == labels
    assert said == []


@pytest.mark.parametrize(
    "spelt",
    [
        lambda name: f"{name[0]}_{name[1:]}",
        lambda name: f"{name[1:]}_{name[0]}",
        lambda name: f"{'Left' if name[0] == 'L' else 'Right'} {name[1:]}",
    ],
)
def test_labels_with_the_letters_of_a_set_are_read_as_those_with_a_fact(spelt):
    names = [*marker_sets()["hbm2_lower"].segment]
    columns = [POSE.names.index(name) for name in names]
    labels = [spelt(n) if n[0] in "LR" else n for n in names]
    found = settled(labels, NOISY[:, columns])
    assert found.names == tuple(names)
    (fact,) = found.notes
    assert fact.kind == "corrected"
    assert f"{spelt('LASIS')} as LASIS" in fact.reason


def exchanged(names, sites):
    pairs = {f"L{site}": f"R{site}" for site in sites}
    both = pairs | {right: left for left, right in pairs.items()}
    return tuple(both.get(name, name) for name in names)


SITES = sorted({name[1:] for name in POSE.names if "R" + name[1:] in POSE.names and name[0] == "L"})


@pytest.mark.parametrize(
    ("sites", "mirrored"), [(("ASIS",), False), (("PSIS",), False), (SITES, False), ((), True)]
)
@pytest.mark.parametrize("axes", [None, AXES])
def test_exchanged_sides_are_named_with_the_options_that_mend_this_file_alone(
    tmp_path, sites, mirrored, axes
):
    position = NOISY * ([1, -1, 1] if mirrored else [1, 1, 1])
    path = tmp_path / "static pose.c3d"
    write_c3d(path, Markers(POSE.time, exchanged(POSE.names, sites), position), axes=AXES)
    try:
        said = " ".join(str(fact) for fact in read_recording(path, axes).facts)
    except ValueError as error:
        said = str(error)
    assert ("mirrored" in said) == (len(sites) != 1)
    rename = renames(said)
    assert all(old.startswith("static pose.c3d:") for old in rename)
    mended = read_recording(path, ReadOptions(axes=axes, rename=rename))
    assert kinds(mended) == []
    # a mirror image cannot be told from exchanged labels
    expected = position[:, POSE.names.index("RASIS" if mirrored else "LASIS")]
    found = mended.markers.position[:, mended.markers.names.index("LASIS")]
    np.testing.assert_allclose(found, expected, atol=1e-5)
    other = path.rename(tmp_path / "walk.c3d")
    if sites == ("ASIS",):
        assert kinds(read_recording(other, ReadOptions(axes=axes, rename=rename))) == ["in_doubt"]


def test_of_two_analog_channels_of_one_label_none_is_taken():
    signals = Analog(np.arange(3) / 100, ("Acc", "Acc", "Belt"), ("V",) * 3, np.zeros((3, 3)))
    with pytest.raises(ValueError, match=r"2 analog channels .*'Acc'"):
        signals.channel("Acc")
