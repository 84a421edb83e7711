"""A trial on a moving platform made of numbers (`tests.pipeline.lab`), ready to be explained."""

from dataclasses import replace

import numpy as np

import pipeline
from pipeline.config.schema import Platform, Settings, Subject, Treadmill
from pipeline.explain.processing_chain import processing_chain
from pipeline.trial.ground.calibration_recording import fit_calibration
from pipeline.trial.ground.laboratory import Laboratory
from tests.pipeline import lab

DURATION_S = 12.0
SETTLED = slice(150, -150)
MARKERS = Platform(markers=tuple(lab.PLATFORM_MARKERS_M))
CHANNELS = Platform(sway_channel="Sway", pitch_channel="Pitch", pivot_m=tuple(lab.PIVOT_M))


def treadmill(platform=CHANNELS):
    return Treadmill(accelerometers=lab.CHANNELS, platform=platform)


def calibration():
    return fit_calibration(lab.on_platform(lab.without_people(20.0), lab.shaken(20.0)), treadmill())


def moved(walker, **faults):
    """The walker on a platform that sways and pitches, recorded without noise."""
    return lab.on_platform(walker, lab.shaken(DURATION_S, seed=3), noise=0.0, **faults)


def chain_of(recording, laboratory):
    result = pipeline.process_recording(
        recording, Subject(sex="male", mass_kg=74.6), Settings(), laboratory=laboratory
    )
    return processing_chain(recording, laboratory, result)


def with_pivot(laboratory, shift):
    platform = laboratory.treadmill.platform
    x, y, z = np.add(platform.pivot_m, shift).tolist()
    stated = platform.model_copy(update={"pivot_m": (x, y, z)})
    return replace(laboratory, treadmill=treadmill(stated))


def laboratory_of(calibration, platform=CHANNELS):
    return Laboratory(treadmill(platform), calibration)
