"""The recordings with what is known of their subjects: each read and processed once."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import pipeline
from hbm.markers import read_marker_set
from pipeline.config.schema import Settings, Subject
from pipeline.io.read import read_recording
from pipeline.io.read_options import ReadOptions
from pipeline.trial.process import process_recording

TESTS = Path(__file__).resolve().parents[1]
AXES = "forward,up,right"
MASS_KG, STATURE_M = 72.84, 1.808
"""Of the generated walk."""


def marker_set(path):
    return read_marker_set(path.read_text(encoding="utf-8"), path.stem)


def treadmill(folder):
    walk = pipeline.read_c3d(folder / "treadmill_hbm2" / "treadmill_events.c3d")
    return walk, {"subject": Subject(mass_kg=55.3, sex="female")}


def steps(folder):
    folder = folder / "plug_in_gait"
    static = pipeline.read_c3d(folder / "Static_trial.c3d")
    person = Subject(mass_kg=85, height_m=1.679, sex="male")
    return pipeline.read_c3d(folder / "Movement_trial.c3d"), {"subject": person, "static": static}


def overground(folder):
    folder = folder / "opensim_subject01"
    forces = folder / "subject01_walk1_grf.mot"
    walk = read_recording(folder / "subject01_walk1.trc", AXES, forces)
    static = read_recording(folder / "subject01_static.trc", AXES)
    known = {"subject": Subject(mass_kg=72.6), "static": static}
    return walk, known


def generated(folder):
    folder = folder / "truth_walk"
    walk = read_recording(folder / "markers.trc", AXES, folder / "grf.mot")
    person = Subject(sex="male", mass_kg=MASS_KG, height_m=STATURE_M)
    return walk, {"subject": person}


@cache
def child(number):
    def read(folder):
        folder = folder / "overground_walks"
        walk, pose = (folder / f"{number}{kind}.c3d" for kind in ("A05", "A01"))
        if not walk.exists():
            walk = folder / f"{number}A06.c3d"
        known = {"subject": Subject(), "static": read_recording(pose, ReadOptions())}
        return read_recording(walk, ReadOptions(), static=pose), known

    read.__name__ = number
    return read


def standing(folder):
    path = folder / "full_body_standing" / "1min_CGM_HBM_static.c3d"
    return pipeline.read_c3d(path), {"subject": Subject(sex="male")}


def two_plates(folder):
    """Overground walking over two plates; the file states no mass."""
    walk = pipeline.read_c3d(folder / "c3d_samples" / "Gait.c3d")
    return walk, {"subject": Subject(mass_kg=72.0)}


def later(recording, delay_s):
    """The same recording with plates that are later."""
    plates = tuple(replace(p, time=p.time + delay_s) for p in recording.plates)
    return replace(recording, plates=plates)


@cache
def recorded(read, folder):
    return read(folder)


def processed(read, folder, delay_s=0.0, **settings):
    return _processed(read, folder, delay_s, Settings(**settings))


@cache
def _processed(read, folder, delay_s, settings):
    recording, known = recorded(read, folder)
    return process_recording(later(recording, delay_s), settings=settings, **known)
