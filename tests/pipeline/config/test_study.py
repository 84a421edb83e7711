"""Everything that can be wrong with the files of a study is reported at once, with its place."""

import re

import pytest

from pipeline.config.schema import Subject
from pipeline.config.study import read_study
from pipeline.config.templates import write_template
from pipeline.config.toml_file import StudyFaults

PLAIN = "[conditions.walk]\n"
PERSON = 'id = "sub01"\n[trials.walk]\nfile = "walk.c3d"\n'


@pytest.fixture
def write(tmp_path):
    """Write a study's files; gives its folder. File names without a suffix are recordings."""

    def write(study=PLAIN, **subjects):
        (tmp_path / "walk.c3d").touch()
        (tmp_path / "study.toml").write_text(study, encoding="utf-8")
        for name, text in (subjects or {"sub01": PERSON}).items():
            (tmp_path / f"{name}.toml").write_text(text, encoding="utf-8")
        return tmp_path

    return write


def faults_of(folder):
    with pytest.raises(StudyFaults) as caught:
        read_study(folder)
    return caught.value.faults


def only_fault_of(folder):
    faults = faults_of(folder)
    assert len(faults) == 1, faults
    return faults[0]


def test_a_study_is_read_from_its_folder_or_its_study_toml(write):
    folder = write()
    assert read_study(folder) == read_study(folder / "study.toml")
    assert list(read_study(folder).subjects) == ["sub01"]


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ({"sex": "f"}, r"sex: .*'male', 'female'.*got 'f'"),
        ({"mass": 83.0}, "mass: .*'mass_kg'"),
        ({"height_m": 185.0}, "height_m: .*2.6, got 185.0 .*metres"),
    ],
)
def test_what_is_wrong_with_a_subject_is_one_line_in_python_too(stated, said):
    with pytest.raises(ValueError, match=f"^Subject: {said}.*$") as caught:
        Subject(**stated)
    assert "\n" not in str(caught.value)


def test_a_decimal_comma_is_said_to_be_a_point(write):
    fault = only_fault_of(write(sub01=f"height_m = 1,64  # by tape\n{PERSON}"))
    assert "height_m = 1,64: " in fault
    assert fault.endswith(" 1.64")


def test_shoes_are_of_a_subject_and_their_sole_has_no_effect_without_their_mass(write):
    shod = "shoe_mass_kg = 0.3\nsole_height_m = 0.025\n"
    subjects = read_study(write(a=shod + PERSON, b=PERSON.replace("sub01", "b"))).subjects
    assert subjects["sub01"].person.shoe_mass_kg == 0.3
    assert subjects["b"].person.shoe_mass_kg is None
    alone = write(a="sole_height_m = 0.02\n" + PERSON, b=PERSON.replace("sub01", "b"))
    assert re.search("sole_height_m: .*shoe_mass_kg", only_fault_of(alone))
    grams = write(a="shoe_mass_kg = 300\n" + PERSON, b=PERSON.replace("sub01", "b"))
    assert "shoe_mass_kg" in only_fault_of(grams)


def test_all_faults_of_all_files_are_reported_at_once(write):
    faults = faults_of(
        write(
            'cutoff_hz = 6.0\n[settings]\ncutof_hz = 6.0\nfilter = "zerophase"\n'
            'mend_plates = ["2: turn 90"]\n[conditions.walk]\ncycles = 0\n',
            a='id = "a"\nsex = "femal"\nheight_m = 178\n[trials.wak]\nfile = "wlk.c3d"\n',
            b="mass_kg = 70\nid = \n",
            c='id = "c"\nmass_kg = "70"\n',
        )
    )
    expected = [
        "study.toml: cutoff_hz: unknown key; it belongs in [settings]",
        "study.toml: settings.cutof_hz: unknown key, did you mean 'cutoff_hz'?",
        "study.toml: settings.mend_plates: unknown key; it belongs above the first [table]",
        "study.toml: settings.filter: input should be 'realtime' or 'zero_phase', "
        "got 'zerophase', did you mean 'zero_phase'?",
        "study.toml: conditions.walk.cycles: input should be greater than or equal to 1, got 0",
        "a.toml: sex: input should be 'male', 'female' or 'unspecified', got 'femal', "
        "did you mean 'female'?",
        "a.toml: height_m: input should be less than or equal to 2.6, got 178 (it is in metres)",
        "a.toml: trials.wak: no such condition in study.toml, did you mean 'walk'?",
        "a.toml: trials.wak.file: no file 'wlk.c3d' in",
        "b.toml: not valid TOML: Invalid value (at line 2, column 6)",
        "c.toml: mass_kg: input should be a valid number, got '70'",
        "c.toml: trials: is missing",
    ]
    assert len(faults) == len(expected), faults
    for line in expected:
        assert any(fault.startswith(line) for fault in faults), (line, faults)
    assert any("mean 'walk.c3d'?" in fault for fault in faults)


@pytest.mark.parametrize(
    ("typed", "message"),
    [
        ("plate_delay_s = 4.0", "in seconds)"),
        ("cutoff_hz = nan", "finite"),
        ("marker_set = 'hbm3'", "nor one of hbm2"),
    ],
)
def test_an_impossible_setting_is_refused_with_its_value(write, typed, message):
    fault = only_fault_of(write(f"[settings]\n{typed}\n{PLAIN}"))
    assert fault.startswith(f"study.toml: settings.{typed.split()[0]}: ")
    assert message in fault


@pytest.mark.parametrize(
    ("typed", "message"),
    [
        ('axes = "left,up,up"', "axes: .*'left,up,up'"),
        ('[treadmill]\ncalibration = "walk.c3d"', "treadmill: accelerometers: "),
        (
            '[treadmill.accelerometers]\na = ["x", "y", "z"]\nb = ["u", "v", "x"]',
            "treadmill.accelerometers: .*but x is",
        ),
        (
            '[treadmill]\ncalibration = "a.c3d"\naccelerometers.a = ["x", "y", "z"]',
            "treadmill.calibration: no file 'a.c3d'",
        ),
        ("[treadmill.platform]", "treadmill.platform: .*sway_channel"),
        (
            '[treadmill.platform]\nsway_channel = "S"\npivot_m = [0, 0, -300]',
            "treadmill.platform.pivot_m.3: .*-2, got -300 .*metres",
        ),
    ],
)
def test_an_impossible_laboratory_is_refused(write, typed, message):
    assert re.match(f"study.toml: {message}", only_fault_of(write(f"{typed}\n{PLAIN}")))


@pytest.mark.parametrize("digits", [7, 23, 400])
@pytest.mark.parametrize("key", ["cycles", "skip_s"])
def test_a_number_beyond_any_recording_is_refused(write, key, digits):
    fault = only_fault_of(write(f"{PLAIN}{key} = 1{'0' * digits}\n"))
    assert fault.startswith(f"study.toml: conditions.walk.{key}: ")


@pytest.mark.parametrize(
    ("person", "message"),
    [
        ('id = "s"\n[trials.walk]\n', "trials.walk: .*exclude ="),
        ('static = "no.c3d"\n' + PERSON, "static: no file 'no.c3d'"),
        (f"a = {'[' * 5000}", "TOML: .*nested"),
        (PERSON + 'window = "motion"', "sub01 walk: window: "),
    ],
)
def test_an_impossible_subject_file_is_refused(write, person, message):
    assert re.search(message, only_fault_of(write(sub01=person)))


def test_what_a_person_writes_reaches_nobody_with_characters_that_steer_a_terminal(write):
    folder = write(sub01='id = "s"\n[trials.walk]\nexclude = "\\u001b[2J ill\\nfor a\\tday"\n')
    assert read_study(folder).subjects["s"].trials["walk"][0].exclude.split() == [
        "?[2J",
        "ill",
        "for",
        "a",
        "day",
    ]


def test_two_trials_with_the_same_result_file_are_refused(write):
    study = "[conditions.c]\n[conditions.b_c]\n"
    one = 'id = "a_b"\n[trials.c]\nfile = "walk.c3d"\n'
    other = 'id = "A"\n[trials.b_c]\nfile = "walk.c3d"\n'
    assert "trial A b_c: " in only_fault_of(write(study, one=one, other=other))


@pytest.mark.parametrize(
    ("more", "name", "fault"),
    [
        ("[variants.a]\nhip = 'bell'\n[variants.A]\ncutoff_hz = 8.0", "sub02", "variant A"),
        ("[conditions.Walk]", "sub02", "condition Walk"),
        ("", "SUB01", "subject SUB01"),
    ],
)
def test_names_that_differ_by_upper_and_lower_case_alone_are_refused(write, more, name, fault):
    """On Windows and macOS one would replace the results of the other."""
    study = f"{PLAIN}[conditions.run]\n{more}\n"
    other = f'id = "{name}"\n[trials.run]\nfile = "walk.c3d"\n'
    assert f"{fault}: files of" in only_fault_of(write(study, a=PERSON, b=other))


@pytest.mark.parametrize("name", ["main", "Main", "MEASURED"])
def test_a_variant_is_not_called_as_what_it_differs_from(write, name):
    fault = only_fault_of(write(f"{PLAIN}[variants.{name}]\ncutoff_hz = 8.0\n"))
    assert f"{name!r} is what" in fault


def test_a_file_in_another_encoding_is_refused(write):
    folder = write()
    (folder / "sub01.toml").write_bytes(PERSON.encode("utf-16"))
    assert "sub01.toml: is not" in only_fault_of(folder)


def test_a_template_is_never_written_over_a_study(tmp_path):
    (tmp_path / "sub01.toml").write_text(PERSON)
    with pytest.raises(ValueError, match=r"sub01\.toml is already there"):
        write_template(tmp_path)
    assert not (tmp_path / "study.toml").exists()


def test_a_folder_without_a_study_says_how_to_start_one(tmp_path):
    assert re.search("no study.toml.*hbm init", only_fault_of(tmp_path))


def test_a_marker_set_in_the_folder_is_not_a_subject_and_its_faults_are_reported(write):
    folder = write(f'[settings]\nmarker_set = "own.toml"\n{PLAIN}')
    (folder / "own.toml").write_text('[markers]\nHEEL = ["left_foot", "LHEE"]\n', encoding="utf-8")
    assert read_study(folder).marker_set.landmark == {"LHEE": "HEEL"}
    (folder / "own.toml").write_text('[markers]\nHEEL = ["left_fot"]\n', encoding="utf-8")
    assert re.search("own.toml: .*HEEL: .*'left_fot'", only_fault_of(folder))


@pytest.mark.parametrize("name", ["COM1.a", "../s", "y" * 300])
def test_a_name_that_no_file_may_have_on_every_system_is_refused(write, name):
    study, subject = faults_of(
        write(
            f'[conditions."{name}"]\n[conditions.walk]\n',
            a=f'id = "{name}"\n[trials.walk]\nexclude = "ill"\n',
        )
    )
    assert study.startswith("study.toml: conditions.")
    assert subject.startswith("a.toml: id: ")


def test_the_template_is_valid_but_for_the_missing_recordings(tmp_path):
    write_template(tmp_path)
    faults, conditions = faults_of(tmp_path), ("baseline", "sway")
    for fault, condition in zip(faults, conditions, strict=True):
        assert fault.startswith(f"sub01.toml: trials.{condition}.file: no file ")
        assert f"'sub01_{condition}.c3d'" in fault
    for name in ("sub01_baseline.c3d", "sub01_sway.c3d"):
        (tmp_path / name).touch()
    study = read_study(tmp_path)
    assert study.file.conditions["sway"].perturbed
    assert study.subjects["sub01"].trials["pitch"][0].exclude == "not recorded yet"


def test_the_template_with_every_key_uncommented_is_valid(tmp_path):
    write_template(tmp_path, every=True)
    for name in ("study.toml", "sub01.toml"):
        text = (tmp_path / name).read_text(encoding="utf-8")
        uncommented = re.sub(r"^# (?=\w+ = |\[)", "", text, flags=re.MULTILINE)
        uncommented = re.sub(
            r"^(sway_channel|pitch_channel).*\n", "", uncommented, flags=re.MULTILINE
        )
        uncommented = uncommented.replace('hip = "harrington"', 'hip = "functional"')
        uncommented = re.sub(r"^condition = .*\n", "", uncommented, flags=re.MULTILINE)
        assert uncommented.count("#") < text.count("#")
        (tmp_path / name).write_text(uncommented, encoding="utf-8")
    faults = faults_of(tmp_path)
    *files, groups = faults
    assert len(files) == 14, faults
    assert all("no file" in fault for fault in files)
    assert "'before surgery'" in groups  # there is one subject
