"""A folder of recordings becomes a study that needs no editing to run, or nothing is written."""

import os
import re
import shutil
from itertools import product

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pipeline.cli.app import main
from pipeline.config.found_recordings import found_subjects
from pipeline.config.recording_names import RecordingName
from pipeline.config.schema import Comparison, Figures, Settings, Treadmill
from pipeline.config.study import read_study
from pipeline.config.templates import write_template
from pipeline.io.read import read_with_any_axes
from pipeline.run.check import check_study
from pipeline.trial.study_files import read_study_file
from pipeline.virtual_lab.machine.c3d_file import write_c3d
from pipeline.virtual_lab.protocol.walking_trial import simulate_trial
from tests.pipeline.cli.test_app import plate
from tests.pipeline.other_formats import excerpt, write_opensim
from tests.synthetic import synthetic_t_pose

USUAL = "{subject}_{condition}_{recording}"
POSE = re.compile(r"(?i)cal|static|stand|pose")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A walk of two steps, and a pose."""
    folder = tmp_path_factory.mktemp("recorded")
    half = np.full(1000, 74.6 * 9.81 / 2)
    write_c3d(folder / "pose.c3d", synthetic_t_pose(), [plate(1, half), plate(2, half)])
    simulate_trial(folder / "walk.c3d", duration_s=2.0)
    return folder


@pytest.fixture(scope="module", autouse=True)
def read_once():
    """A recording is read once, however many links there are to it."""
    recordings = {}

    def read(path):
        status = path.stat()
        key = status.st_ino, status.st_mtime_ns
        if key not in recordings:
            recordings[key] = read_with_any_axes(path)
        return recordings[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pipeline.config.found_recordings.read_with_any_axes", read)
        yield read


@pytest.fixture
def named(recorded, tmp_path):
    """Put recordings of such names into a folder: a pose where the name says so, else a walk."""

    def put(*names, folder=tmp_path / "named"):
        shutil.rmtree(folder, ignore_errors=True)
        for name in names:
            path = folder / f"{name}.c3d"
            path.parent.mkdir(parents=True, exist_ok=True)
            os.link(recorded / f"{'pose' if POSE.search(name) else 'walk'}.c3d", path)
        return folder

    return put


@pytest.fixture
def folder(tmp_path):
    """Two subjects; one has a pose, the other two walks alone; and files that are none."""
    half = np.full(1000, 74.6 * 9.81 / 2)
    write_c3d(tmp_path / "S01_0.c3d", synthetic_t_pose(), [plate(1, half), plate(2, half)])
    simulate_trial(tmp_path / "S01_4.c3d", duration_s=8.0)
    for name in ("S02_5.c3d", "S02_6.c3d"):
        shutil.copy(tmp_path / "S01_4.c3d", tmp_path / name)
    (tmp_path / "notes.txt").write_text("measured on Monday")
    (tmp_path / "broken.c3d").write_bytes(b"no recording")
    (tmp_path / ".S01_5.c3d.1a2b3c4d.part").write_bytes((tmp_path / "S01_4.c3d").read_bytes())
    return tmp_path


def test_recordings_are_grouped_by_subject_and_the_stillest_is_the_pose(folder):
    found = found_subjects(folder)
    first, second = found.subjects
    assert first == ("S01", "S01_0.c3d", "", {"walking": [{"file": "S01_4.c3d"}]})
    assert second == ("S02", "", "", {"walking": [{"file": "S02_5.c3d"}, {"file": "S02_6.c3d"}]})
    assert list(found.unused) == ["broken.c3d", "notes.txt"]


def test_a_pose_without_a_trial_is_not_skipped_silently(named):
    found = found_subjects(named("S01_static", "S02_5"))
    assert [one.name for one in found.subjects] == ["S02"]
    assert found.unused["S01_static.c3d"].startswith("there is no trial")


BIDS = "sub-01/ses-01/motion/sub-01_ses-01_task-"


@pytest.mark.parametrize(
    ("names", "people"),
    [
        (
            ("P01_slow_1", "P01_slow_2", "P01-cal", "P02_fast_1", "P02-cal"),
            {"P01": "P01-cal slow slow", "P02": "P02-cal fast"},
        ),
        (("GAIT_S01_slow", "GAIT_S02_slow"), {"S01": " gait-slow", "S02": " gait-slow"}),
        (("slow_P01_1", "slow_P02_1", "static_P02"), {"P01": " slow", "P02": "static_P02 slow"}),
        (
            ("2024-05-03_P01_slow_1", "2024-05-03_P01_static", "2024-05-10_P02_slow_1"),
            {"P01": "2024-05-03_P01_static slow", "P02": " slow"},
        ),
        (
            ("P01/slow/Trial01", "P01/fast/Trial01", "P01/Kalibrierung", "P02/slow/Trial01"),
            {"P01": "P01/Kalibrierung fast slow", "P02": " slow"},
        ),
        (
            ("S01_fast walk_1", "S01 Tpose", "S02_gång_1"),
            {"S01": "S01 Tpose fast-walk", "S02": " gang"},
        ),
        (("S01_walk v1.2", "S01_walk v1.3"), {"S01": " walk-v1-2 walk-v1-3"}),
        (
            ("sub-01_task-walk_run-1", "sub-01_task-walk_run-2", "sub-02_task-run_run-1"),
            {"sub01": " walk walk", "sub02": " run"},
        ),
        (("Trial01", "Trial02", "Cal01"), {"sub01": "Cal01 walking walking"}),
        (("walk_1", "walk_2", "static"), {"sub01": "static walk walk"}),
        (("shoes_1", "barefoot_1", "standing"), {"sub01": "standing barefoot shoes"}),
        (
            ("S01FastWalk1", "S01Static", "Subject 2 walk"),
            {"S01": "S01Static fastwalk", "Subject2": " walk"},
        ),
        (("s01_walk_1", "S01_walk_2"), {"s01": " walk walk"}),
        (("S01_group_1", "S01_sex_1"), {"S01": " group-2 sex-2"}),
        (
            ("S01/S01_walk1", "S02/S02_walk1", "S01/S01_cal"),
            {"S01": "S01/S01_cal walk", "S02": " walk"},
        ),
        (
            (f"{BIDS}walk_run-1_motion", f"{BIDS}walk_run-2_motion", f"{BIDS}static_motion"),
            {"sub01": f"{BIDS}static_motion ses01-walk ses01-walk"},
        ),
        (("S01_240503_walk1", "S01_240503_cal"), {"S01": "S01_240503_cal walk"}),
        (("S01_pre_walk1", "S01_post_walk1", "S01_cal"), {"S01": "S01_cal post-walk pre-walk"}),
        (("S01_sneakers_1", "S01_loafers_1", "S01_cal_1"), {"S01": "S01_cal_1 loafers sneakers"}),
        (("S01_xy_KneeL_1", "S01_xy_cal"), {"S01": "S01_xy_cal xy-kneel"}),
        (("S01_01_cal", "S01_02_walk", "S01_03_walk"), {"S01": "S01_01_cal walk walk"}),
        (
            ("P01 slow 01", "P01 slow 02", "P02 slow 01"),
            {"P01": " slow slow", "P02": " slow"},
        ),
        (("Sub1Walk03", "Sub2Walk01", "Sub1Static"), {"Sub1": "Sub1Static walk", "Sub2": " walk"}),
        (("P01/Static", "P01/walk1", "P02/walk1"), {"P01": "P01/Static walk", "P02": " walk"}),
        (
            ("P1T1", "P1T2", "P2T1", "P1_cal"),
            {"P1": "P1_cal walking walking", "P2": " walking"},
        ),
        (
            ("P01_T0_walk_1", "P01_T1_walk_1", "P01_T1_walk_2"),
            {"P01": " t0-walk t1-walk t1-walk"},
        ),
        (
            ("S01/2024-05-03/slow 1", "S02/2024-05-04/slow 1", "S01/2024-05-03/static"),
            {"S01": "S01/2024-05-03/static slow", "S02": " slow"},
        ),
        (("24-05-03_P01_slow_1", "24-05-04_P02_slow_1"), {"P01": " slow", "P02": " slow"}),
        (("c3d/P01_slow_1", "c3d/P02_slow_1"), {"P01": " slow", "P02": " slow"}),
        (("Pat12_pre_walk1", "Pat12_post_walk1"), {"Pat12": " post-walk pre-walk"}),
        (
            ("Dynamic01_P05", "Static_P05", "Dynamic01_P06"),
            {"P05": "Static_P05 walking", "P06": " walking"},
        ),
    ],
)
def test_names_are_read_as_people_mean_them(named, names, people):
    """Subject -> its pose, and the condition of each of its trials."""
    found = found_subjects(named(*names)).subjects
    assert {one.name.lower(): said(one) for one in found} == {
        k.lower(): v for k, v in people.items()
    }


def said(one):
    conditions = sorted(name for name, files in one.trials.items() for _ in files)
    return " ".join([one.static.removesuffix(".c3d"), *conditions])


@pytest.mark.parametrize(
    ("names", "pattern", "people"),
    [
        (("AB_slow_1", "CD_slow_1", "AB_static"), USUAL, {"AB": "AB_static slow", "CD": " slow"}),
        (("anna_slow_1", "bert_fast_1"), USUAL, {"anna": " slow", "bert": " fast"}),
        (("anna_1", "anna_2", "static"), "{subject}_*", {"anna": "static walking walking"}),
        (("O'Neil_walk_1", "O'Neil_static"), USUAL, {"ONeil": "O'Neil_static walk"}),
        (("con_walk_1", "con_walk_2"), USUAL, {"con-2": " walk walk"}),
        (
            ("Pat_1", "Pat_2"),
            "{subject}_{subject}",
            {"Pat-1": " walking", "Pat-2": " walking"},
        ),
        (
            ("sneakers_1", "loafers_1", "static"),
            "{condition}_{recording}",
            {"sub01": "static loafers sneakers"},
        ),
        (("01_slow", "02_slow"), USUAL, {"01": " slow", "02": " slow"}),
        (("王_walk_1", "李_walk_1"), USUAL, {"Wang": " walk", "Li": " walk"}),
        (
            ("Sørensen_barfuß_1", "Łukasz_barfuß_1", "李娜_barfuß_1", "李那_barfuß_1"),
            USUAL,
            dict.fromkeys(("Sorensen", "Lukasz", "LiNa", "LiNa-2"), " barfuss"),
        ),
        (
            ("anna_P1_slow", "anna_P2_slow"),
            "{condition}_{subject}_{condition}",
            {"P1": " anna-slow", "P2": " anna-slow"},
        ),
        (
            ("P01_S02_walk", "P02_S02_walk"),
            "{subject}_{condition}_{condition}",
            {"P01": " s02-walk", "P02": " s02-walk"},
        ),
        (
            ("KO03", "KO04", "AB03"),
            "{subject}",
            dict.fromkeys(("KO03", "KO04", "AB03"), " walking"),
        ),
        (("19980312_walk", "20011105_walk"), USUAL, {"19980312": " walk", "20011105": " walk"}),
        (
            ("S1_AB_walk1", "S1_CD_walk1", "S1_AB_static", "S1_CD_static"),
            "{condition}_{subject}_{condition}{recording}",
            {"AB": "S1_AB_static s1-walk", "CD": "S1_CD_static s1-walk"},
        ),
        (
            ("fast_S1_AB", "fast_S1_CD", "static_S1_CD"),
            "{condition}_{condition}_{condition}",
            {"sub01": " fast-s1-ab fast-s1-cd"},
        ),
        (
            ("CTRL/P01/walk1", "STROKE/P01/walk1"),
            "{subject}/{subject}/{condition}{recording}",
            {"CTRL-P01": " walk", "STROKE-P01": " walk"},
        ),
        (
            ("HC_01_walk1", "HC_02_walk1", "PD_01_walk1", "HC_01_static"),
            "{subject}_{subject}_{condition}{recording}",
            {"HC-01": "HC_01_static walk", "HC-02": " walk", "PD-01": " walk"},
        ),
        (
            ("Smith_J_fast_2", "Doe_A_fast_1", "Smith_J_static"),
            "{subject}_{subject}_{condition}_{recording}",
            {"Smith-J": "Smith_J_static fast", "Doe-A": " fast"},
        ),
        (
            ("AnnaSlow1", "AnnaSlow2", "BertFastWalk1"),
            "{subject}{condition}{recording}",
            {"Anna": " slow slow", "Bert": " fastwalk"},
        ),
        (
            ("slow_01_1", "slow_02_1", "fast_01_1"),
            "{condition}_{subject}_{recording}",
            {"01": " fast slow", "02": " slow"},
        ),
        (
            ("data/01/walk", "data/02/walk"),
            "*/{subject}/{condition}",
            {"01": " walk", "02": " walk"},
        ),
        (
            ("walk_1", "walk_2", "static_1", "static_2"),
            "{condition}_{subject}",
            {"1": "static_1 walk", "2": "static_2 walk"},
        ),
        (
            ("S1_anna_walk", "S1_bob_walk", "S2_bob_walk"),
            "*_{subject}_{condition}",
            {"anna": " walk", "bob": " walk walk"},
        ),
        (
            ("anna/slow/Trial01", "bert/slow/Trial01", "bert/Static"),
            "{subject}/{condition}/*",
            {"anna": " slow", "bert": "bert/Static slow"},
        ),
    ],
)
def test_where_names_can_be_read_in_two_ways_nothing_is_written_until_a_pattern_decides(
    named, capsys, names, pattern, people
):
    """Each way is shown as a pattern with whom and what it finds; one of them is advised."""
    folder = named(*names)
    assert main(["init", str(folder)]) == 2
    out, error = capsys.readouterr()
    assert len(error.splitlines()) == 1
    assert "whose it is" in error
    assert "--pattern" in error
    assert out.count("--pattern") > 1
    assert not list(folder.rglob("*.toml"))
    assert main(["init", str(folder), "--pattern", pattern]) == 0
    assert len(read_study(folder).subjects) == len(people)
    found = found_subjects(folder, pattern).subjects
    assert {one.name: said(one) for one in found} == people
    readings = found_subjects(folder).readings
    assert all(found_subjects(folder, way).subjects == way_of for way, way_of in readings.items())


OTHERS = [
    ("S1/AB_{}", "S1/CD_{}"),
    ("{}_S1_AB", "{}_S1_CD"),
    ("S1_anna_{}", "S1_bob_{}", "S2_bob_{}"),
    ("normal/P01/{}", "prosthesis/P01/{}"),
    ("CTRL/P01/{}", "STROKE/P01/{}"),
    ("control/01/{}", "control/02/{}", "patient/01/{}"),
    ("AB_{}", "AB2_{}", "CD_{}", "EF_{}"),
    ("01_{}", "02_{}"),
    ("S01_240503_{}", "S01_240604_{}"),
    ("Day1/S01_{}", "Day2/S01_{}"),
    ("S01_session1_{}", "S01_session2_{}"),
    ("S01_pre_{}", "S01_post_{}"),
    ("sub-01/ses-01/{}", "sub-01/ses-02/{}"),
]


@pytest.mark.parametrize("recorded_as", OTHERS)
def test_whatever_pattern_is_stated_no_pose_serves_another_person_or_day(named, recorded_as):
    """With poses of all, of the first alone, and of one who has no trial."""
    walks, poses = ([name.format(kind) for name in recorded_as] for kind in ("walk1", "static"))
    for names in ([*walks, *poses], [*walks, poses[0]], [*walks[1:], poses[0]]):
        folder = named(*names)
        ways = (way for walk in walks for _, way in RecordingName.of(f"{walk}.c3d").patterns())
        for pattern in ("", *(way for way in dict.fromkeys(ways) if "{subject}" in way)):
            try:
                found = found_subjects(folder, pattern).subjects
            except ValueError:
                continue
            if any("walk" in one.name for one in found):
                continue  # that is nobody
            for one in found:
                served = {
                    trial["file"].replace("walk1", "static")
                    for trials in one.trials.values()
                    for trial in trials
                }
                assert not one.static or served == {one.static}


ORDERS = (
    *("{p}_{c}_{r}", "{c}_{p}_{r}", "{p}/{c}/{r}", "{p} {c} {r}", "{p}{c}{r}", "{c}/{p}_{r}"),
    *("2024-05-03_{p}_{c}_{r}", "raw/{p}/{c}{r}", "{p}.{c}.{r}", "{p}_T1_{c}_{r}", "{r}_{p}_{c}"),
    *(
        "{c}{r}_{p}",
        "{p}_{c}_Trial0{r}",
        "{p}_{r}",
        "S1_{p}_{c}_{r}",
        "{c}_{r}_{p}",
        "Day1/{p}_{c}_{r}",
        "2024-05-03_{p}_{c}_{r:02d}",
    ),
)
PEOPLE = (
    *(("P01", "P02"), ("AB", "CD"), ("EC", "MS"), ("anna", "bert"), ("1", "2"), ("S1", "S2")),
    *(("Smith_J", "Doe_A"), ("sub-1", "sub-2"), ("Pat 1", "Pat 2"), ("HC_01", "PD_01")),
    *(("KO03", "KO04"), ("Subject A", "Subject B"), ("12345", "67890"), ("JdV", "MvB")),
)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("conditions", [("slow", "fast"), ("normaal", "schoen")])
def test_no_habit_of_naming_makes_a_study_of_wrong_people(
    recorded, tmp_path, read_once, monkeypatch, order, conditions
):
    """Two people, two conditions, two recordings each and a pose: they are found, or nobody is.

    Each pattern that is shown in that case gives the study that is shown.
    """
    files = {kind: read_once(recorded / f"{kind}.c3d") for kind in ("walk", "pose")}
    read = lambda path: files["pose" if "static" in str(path) else "walk"]  # noqa: E731
    monkeypatch.setattr("pipeline.config.found_recordings.read_with_any_axes", read)
    for number, people in enumerate(PEOPLE):
        folder, whose = tmp_path / str(number), dict[str, str]()
        for p, c, r in product(people, conditions, (1, 2)):
            whose[f"{order.format(p=p, c=c, r=r)}.c3d"] = p
        whose[f"{order.format(p=people[0], c='static', r=1)}.c3d"] = people[0]
        for name in whose:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).touch()
        found = found_subjects(folder)
        of_subjects = [{whose[file] for file in one.files} for one in found.subjects]
        assert found.readings or sorted(map(sorted, of_subjects)) == [[p] for p in sorted(people)]
        for pattern, subjects in found.readings.items():
            assert found_subjects(folder, pattern).subjects == subjects
        meant = [[person] for person in sorted(people)]
        ways = [
            sorted(sorted({whose[file] for file in one.files}) for one in way)
            for way in found.readings.values()
        ]
        if people == ("JdV", "MvB") and order.startswith("2024"):
            assert ways[0] == meant
        unclear = order == "{p}{c}{r}" or (  # such as normaal_1_2
            order == "{c}_{r}_{p}" and people[0].isdecimal() and conditions[0] == "normaal"
        )
        if found.readings and not unclear:  # one of them is what was meant
            assert meant in ways


def test_groups_whose_numbers_are_the_same_have_the_pose_of_each_person(named):
    folder = named(
        *(f"{who}/{kind}" for who in ("CTRL/P01", "STROKE/P01") for kind in ("walk1", "static"))
    )
    found = found_subjects(folder, "{subject}/{subject}/{condition}{recording}").subjects
    assert [said(one) for one in found] == ["CTRL/P01/static walk", "STROKE/P01/static walk"]


def test_one_person_with_two_spellings_is_asked_for(named, capsys):
    assert main(["init", str(named("P1_slow_1", "P01_slow_2"))]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "P01 and P1 may" in line


@pytest.mark.parametrize(
    ("pattern", "message"),
    [
        ("{person}_{condition}", "--pattern: .*'person'; .*subject, condition"),
        ("{condition}_{recording}", "P01, P02"),
        ("{subject}-{condition}", "P01/slow_1.c3d"),
    ],
)
def test_a_pattern_that_does_not_fit_says_so_in_one_line(named, capsys, pattern, message):
    folder = named("P01/slow_1", "P02/slow_1")
    assert main(["init", str(folder), "--pattern", pattern]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert re.search(message, line)
    assert not list(folder.rglob("*.toml"))


def test_a_written_study_holds_what_is_used_and_with_all_every_setting(named):
    folder = named("S01_walk_1", "S01_walk_2", "S01_cal", "S01_ROM", "S02_run_1")
    assert main(["init", str(folder)]) == 0
    study = (folder / "study.toml").read_text(encoding="utf-8")
    person = (folder / "S01.toml").read_text(encoding="utf-8")
    assert len(study.splitlines()) <= 25
    assert "cutoff_hz" not in study
    assert 'files = ["S01_walk_1.c3d", "S01_walk_2.c3d"]' in person
    for key in (
        "# mass_kg = ",
        "# height_m = ",
        '# hip_trial = "S01_ROM.c3d"',
        'sex = "unspecified"',
    ):
        assert f"\n{key}" in person
    for file in folder.glob("*.toml"):
        file.unlink()
    assert main(["init", str(folder), "--all"]) == 0
    study = (folder / "study.toml").read_text(encoding="utf-8")
    for table in (Settings, Treadmill, Comparison, Figures):
        keys = [rf"^(# )?(\[.*)?{key}\b" for key in table.model_fields]
        assert all(re.search(key, study, re.MULTILINE) for key in keys)
    assert read_study(folder).subjects["S01"].static == "S01_cal.c3d"


def test_the_calibration_of_a_moving_treadmill_is_found(moving_study, tmp_path, capsys):
    """Nobody is on it, and it has accelerometers; the study checks without being edited."""
    for path in moving_study.glob("*.c3d"):
        os.link(path, tmp_path / path.name)
    assert main(["init", str(tmp_path)]) == 0
    assert "treadmill: empty.c3d" in capsys.readouterr().out
    study = read_study(tmp_path)
    assert study.file.treadmill.calibration == "empty.c3d"
    assert len(study.file.treadmill.accelerometers) == 2
    assert len(study.trials) == 6


def test_a_recording_that_is_being_copied_is_no_trial(named):
    folder = named("S01_walk1", "S01_walk2")
    (folder / "S01_walk2.c3d").rename(folder / "S01_walk2.c3d.part")
    found = found_subjects(folder)
    assert found.subjects[0].trials == {"walk": [{"file": "S01_walk1.c3d"}]}
    assert list(found.unused) == ["S01_walk2.c3d.part"]
    assert "part of a file" in found.unused["S01_walk2.c3d.part"]


def test_what_is_not_used_is_said_with_the_reason(named):
    folder = named(
        *("S01_walk_1", "S01_static_1", "S01_static_2", "S01_ROM", "walk_7", "old/S02_walk_1"),
        *("20240503_S03_walk", "20240510_S03_walk", "20240503_S03_cal"),
    )
    (folder / "old" / "study.toml").touch()
    found = found_subjects(folder)
    first, third = found.subjects
    assert first[:3] == ("S01", "S01_static_1.c3d", "S01_ROM.c3d")
    assert third[:3] == ("S03", "", "")
    days = [trial["session"] for trial in third.trials["walk"]]
    assert days == ["20240503", "20240510"]
    reasons = {
        "S01_static_2.c3d": "S01_static_1.c3d",
        "walk_7.c3d": "whose it is",
        "old/S02_walk_1.c3d": "study of its",
        "20240503_S03_cal.c3d": "several days",
        "old/study.toml": "no recording",
    }
    assert found.unused.keys() == reasons.keys()
    assert all(word in found.unused[name] for name, word in reasons.items())


PARTS = st.text(st.characters(exclude_characters="/\0", exclude_categories=("Cs",)), max_size=12)
ODD = st.sampled_from(
    ["con", "study", "Walk", "walk", "a.b", "Ä'", '"', "\\", "😀", "v1.2", "..", "#"]
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=20)
@given(
    st.lists(
        st.tuples(st.sampled_from(["S1", "s1", "S2", ""]), st.one_of(PARTS, ODD)),
        min_size=1,
        max_size=5,
    )
)
def test_every_study_that_is_written_is_read_whatever_the_names(named, stems):
    """Subjects and conditions of any letters, in upper and lower case, with quotes and blanks."""
    names = {f"{number}_{word}_{k}" for k, (number, word) in enumerate(stems)}
    folder = named(*names)
    patterns = ("", "{subject}_*", "*")
    written = (p for p in patterns if not main(["init", str(folder), "--quiet", "--pattern", p]))
    pattern = next(written)
    study = read_study_of(folder)
    if study is None:
        return  # all names have letters that cannot be printed: an example
    used = [file for trial in study.trials.values() for file in trial.files]
    used += [person.static for person in study.subjects.values() if person.static]
    assert len(set(used)) == len(used) <= len(names)
    for person in study.subjects.values():
        files = [trial.file for trials in person.trials.values() for trial in trials]
        numbers = {file[:2].upper() for file in files if file[:2].upper() in ("S1", "S2")}
        assert len(numbers) <= 1 or pattern == "*"


def read_study_of(folder):
    """The study that was written of recordings; None where there are none that can be used."""
    example = any("baseline" in path.read_text("utf-8") for path in folder.glob("sub01.toml"))
    return None if example else read_study(folder)


def test_a_study_of_the_recordings_in_a_folder_runs_as_it_is_written(folder, tmp_path, capsys):
    assert main(["init", str(folder)]) == 0
    rows = [row.split() for row in capsys.readouterr().out.replace("│", " ").splitlines()]
    assert ["S01", "S01_0.c3d", "1:"] in rows
    assert rows[rows.index(["S01", "S01_0.c3d", "1:"]) + 1] == ["S01_4.c3d"]
    study = read_study(folder)
    assert [str(name) for name in study.trials] == [
        "S01 walking",
        "S02 walking 01",
        "S02 walking 02",
    ]
    (copied,) = check_study(study).faults
    assert re.search("same recording.* S02 walking 01", copied.said)
    results = tmp_path / "results"
    assert main(["run", str(folder), "--subject", "S01", "--out", str(results)]) == 0
    assert (results / "trials" / "S01_walking.parquet").is_file()


def test_options_of_a_trial_are_refused_for_a_folder(folder, capsys):
    assert main([str(folder), "--mass-kg", "74.6"]) == 2
    error = capsys.readouterr().err
    assert "--mass-kg" in error
    assert str(folder) in error


def test_an_empty_folder_gets_an_example(tmp_path, capsys):
    assert main(["init", str(tmp_path / "new")]) == 0
    assert "sub01.toml (a template" in capsys.readouterr().out


def test_real_children_have_their_pose_found(shared_data):
    found = found_subjects(shared_data / "overground_walks").subjects
    assert [(one.name, one.static) for one in found] == [
        ("HC030", "HC030A01.c3d"),
        ("HC031", "HC031A01.c3d"),
    ]


def test_labels_of_one_recording_are_corrected_in_its_trial(tmp_path):
    """Of exchanged knees the recording, and not the pose, has both directions of the pair."""
    half = np.full(1000, 74.6 * 9.81 / 2)
    write_c3d(tmp_path / "S01_static.c3d", synthetic_t_pose(), [plate(1, half), plate(2, half)])
    simulate_trial(tmp_path / "S01_1.c3d", duration_s=8.0)
    assert main(["init", str(tmp_path)]) == 0
    file = tmp_path / "S01.toml"
    rename = '[trials.walking.rename]\nLLEK = "RLEK"\nRLEK = "LLEK"\n'
    file.write_text(f"{file.read_text(encoding='utf-8')}\n{rename}", encoding="utf-8")
    study = read_study(tmp_path)
    (trial,) = study.trials.values()
    walk, static = (
        read_study_file(study, "S01_1.c3d", trial),
        read_study_file(study, "S01_static.c3d"),
    )
    plain = read_study_file(study, "S01_1.c3d")
    left, right = (plain.markers.names.index(name) for name in ("LLEK", "RLEK"))
    assert walk.markers.names.index("LLEK") == right
    assert walk.markers.names.index("RLEK") == left
    assert not static.options.rename


def test_forces_beside_a_trc_file_are_those_of_its_trial(walker, tmp_path):
    plain = excerpt(walker, 400, 800)
    for name in ("S01_walk_01", "S01_walk_02"):
        write_opensim(plain, tmp_path / f"{name}.trc", tmp_path / f"{name}_grf.mot")
    found = found_subjects(tmp_path)
    assert found.unused == {}
    write_template(tmp_path, found.subjects)
    trials = read_study(tmp_path).trials.values()
    assert [(t.file, t.forces) for t in trials] == [
        (f"S01_walk_{k}.trc", f"S01_walk_{k}_grf.mot") for k in ("01", "02")
    ]
