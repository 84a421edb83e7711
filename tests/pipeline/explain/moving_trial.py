"""A trial on a moving platform made of numbers (`tests.pipeline.lab`), ready to be explained."""

import tempfile
from dataclasses import replace
from functools import cache

import numpy as np

import pipeline
from pipeline.config.schema import Platform, Settings, Subject, Treadmill
from pipeline.explain.linearise import result_chain
from pipeline.trial.ground.calibrations import fit_calibration
from pipeline.trial.ground.laboratory import Laboratory
from tests.pipeline import lab

DURATION_S = 12.0
SETTLED = slice(150, -150)
MARKERS = Platform(markers=tuple(lab.PLATFORM_MARKERS_M))
CHANNELS = Platform(sway_channel="Sway", pitch_channel="Pitch", pivot_m=tuple(lab.PIVOT_M))


@cache
def laboratory():
    empty = lab.on_platform(lab.without_people(20.0), lab.shaken(20.0))
    return Laboratory(treadmill(CHANNELS), fit_calibration(empty, treadmill(CHANNELS)))


@cache
def walker():
    with tempfile.TemporaryDirectory() as folder:
        return lab.walk(folder, duration_s=DURATION_S, marker_noise_m=0.0)


@cache
def moving_chain():
    """The chain of a trial without faults, its pose from the platform's channels."""
    return chain_of(moved(), laboratory())


def moved(**faults):
    """The walker on a platform that sways and pitches, recorded without noise."""
    return lab.on_platform(walker(), lab.shaken(DURATION_S, seed=3), noise=0.0, **faults)


def chain_of(recording, laboratory):
    result = pipeline.process_recording(
        recording, Subject(sex="male", mass_kg=74.6), Settings(), laboratory=laboratory
    )
    return result_chain(recording, laboratory, result).of_frames(slice(None))


def with_platform(platform):
    """The laboratory with another statement of how the pose is known."""
    return replace(laboratory(), treadmill=treadmill(platform))


def with_pivot(shift):
    x, y, z = np.add(lab.PIVOT_M, shift).tolist()
    return with_platform(CHANNELS.model_copy(update={"pivot_m": (x, y, z)}))


def treadmill(platform):
    return Treadmill(accelerometers=lab.CHANNELS, platform=platform)
