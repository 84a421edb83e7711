"""Recordings of experiment 1 are read in any format, or refused in one line."""

import re
import shutil

import numpy as np
import pytest

from pipeline.cli.app import main
from pipeline.config.plate_study import read_plates_study
from pipeline.io.c3d.read import read_c3d
from pipeline.plate_accuracy.accuracy import check_plates
from pipeline.plate_accuracy.trials import (
    UNALIGNED,
    read_hammer_delay,
    read_weight,
    read_with_marker,
    static_places,
)
from pipeline.virtual_lab.protocol.known_weights import PlateErrors, simulate_plates
from tests.pipeline.other_formats import write_dflow
from tests.pipeline.plate_accuracy.conftest import DESIGN

FEW = DESIGN | {"speeds": (1.0,), "belts": ("left",)}
ERRORS = PlateErrors(cross_talk={(2, 2): 0.03}, delay_s=0.006)
LEFT_BELT = "\n[surface.left]\nx_m = [-0.9, 0.9]\ny_m = [0.0, 0.5]\n"


@pytest.fixture(scope="module")
def in_c3d(tmp_path_factory):
    folder = tmp_path_factory.mktemp("c3d")
    simulate_plates(folder, ERRORS, seed=4, **FEW)
    return folder


@pytest.fixture(scope="module")
def in_text(in_c3d, tmp_path_factory):
    """The same study as D-Flow records it: text, plates at the rate of the cameras."""
    folder = tmp_path_factory.mktemp("text")
    for path in in_c3d.glob("*.c3d"):
        write_dflow(read_c3d(path, "left,back,up"), folder / f"{path.stem}.txt")
    stated = (in_c3d / "plates.toml").read_text(encoding="utf-8").replace(".c3d", ".txt")
    stated = stated.replace("left,back,up", "right,up,back")
    stated = re.sub(r"\[\[hammer\]\].*?\n\n", "", stated, flags=re.DOTALL)
    (folder / "plates.toml").write_text(stated + LEFT_BELT, encoding="utf-8")
    return folder


def read_first(folder):
    study = read_plates_study(folder)
    return read_weight(study, study.file.weights[0], UNALIGNED)


def edited(folder, tmp_path, old, new):
    copy = shutil.copytree(folder, tmp_path / "study")
    text = (copy / "plates.toml").read_text(encoding="utf-8")
    assert old in text
    (copy / "plates.toml").write_text(text.replace(old, new), encoding="utf-8")
    return copy


def test_a_weight_in_text_is_the_one_in_c3d(in_c3d, in_text):
    """Up to what the plate does between samples at 100 Hz: its noise, 1 N at 1000 Hz."""
    one, other = read_first(in_c3d), read_first(in_text)
    np.testing.assert_array_equal(one.center, other.center)
    assert one.belt_ends == pytest.approx(other.belt_ends)
    slower = (one.time >= other.time[0]) & (one.time <= other.time[-1])
    np.testing.assert_allclose(one.time[slower], other.time, atol=1e-9)
    inside = slice(30, -30)
    np.testing.assert_allclose(one.marker[slower][inside], other.marker[inside], atol=1e-4)
    error = (one.measured[slower] - other.measured)[inside]
    assert np.sqrt(np.mean(error**2, axis=0)).max() < 1.0


def test_places_in_text_are_those_in_c3d(in_c3d, in_text):
    (plate, camera), (plate_text, camera_text) = (
        static_places(read_plates_study(folder), "left") for folder in (in_c3d, in_text)
    )
    np.testing.assert_allclose(camera_text, camera, atol=2e-4)
    np.testing.assert_allclose(plate_text, plate, atol=5e-3)


def test_a_study_in_text_finds_the_gain_and_the_delay_of_its_plate(in_text):
    """The weights in motion show the delay; at 100 Hz no hammer is needed for it."""
    found = {one.fault: one for one in check_plates(read_plates_study(in_text)).faults}
    gain, delay = found["gain of Fz"], found["delay in motion"]
    assert gain.significant
    assert gain.value == pytest.approx(0.03, abs=3 * gain.uncertainty)
    assert delay.value == pytest.approx(0.006, abs=3 * delay.uncertainty)
    assert delay.uncertainty < 0.001


def test_where_a_plate_is_has_to_be_stated_where_the_files_do_not_say_it(in_text, tmp_path, capsys):
    assert main(["plates", str(edited(in_text, tmp_path, LEFT_BELT, ""))]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert re.search(r"static_left\.txt: .*plate 1 .*left belt", error)


def test_a_stated_surface_is_taken_in_place_of_that_of_the_file(in_c3d, tmp_path):
    """The wrench is then about another point and in the lab's axes, and is the same."""
    folder = shutil.copytree(in_c3d, tmp_path / "study")
    with (folder / "plates.toml").open("a", encoding="utf-8") as file:
        file.write("\n[surface.left]\nx_m = [-0.8, 0.9]\ny_m = [0.0, 0.4]\n")
    (of_file, *_), (stated, *_) = (
        read_with_marker(read_plates_study(each), "weight_001.c3d", "left", "WEIGHT")
        for each in (in_c3d, folder)
    )
    np.testing.assert_allclose(stated.center, [0.05, 0.2, 0.0])
    np.testing.assert_allclose(stated.wrench, of_file.wrench, atol=1e-9)


def test_a_plate_with_gaps_is_refused(in_text, tmp_path):
    """D-Flow drops frames, which is a gap in plates and markers alike."""
    folder = shutil.copytree(in_text, tmp_path / "study")
    path = folder / "weight_001.txt"
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    path.write_text("".join(lines[:100] + lines[110:]), encoding="utf-8")
    with pytest.raises(ValueError, match=r"weight_001\.txt: .*'WEIGHT' .*gap"):
        read_first(folder)


def test_a_hammer_at_the_rate_of_the_cameras_is_refused_with_what_to_do(in_c3d, in_text, tmp_path):
    """Its delay would be off by up to a millisecond: contacts and bounces lie between samples."""
    folder = shutil.copytree(in_text, tmp_path / "study")
    recording = read_c3d(in_c3d / "hammer_left.c3d", "left,back,up")
    write_dflow(recording, folder / "hammer_left.txt")
    with (folder / "plates.toml").open("a", encoding="utf-8") as file:
        file.write('\n[[hammer]]\nfile = "hammer_left.txt"\nbelt = "left"\n')
    study = read_plates_study(folder)
    with pytest.raises(ValueError, match=r"hammer_left\.txt: .*100 Hz"):
        read_hammer_delay(study, study.file.hammer[0])
