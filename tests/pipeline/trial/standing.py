"""Recordings of somebody who stands: two plates, a few markers, made to order."""

from dataclasses import replace

import numpy as np

from hbm.markers import Markers
from hbm.spatial import GRAVITY_MPS2
from pipeline.io.recording import Metadata, Plate, Recording

NAMES = ("LASIS", "RASIS", "LHEE", "RHEE", "C7")
WEIGHT_N = 80.0 * GRAVITY_MPS2


def standing(duration_s=12.0, *, loads_n=None, speed_mps=0.0, noise_n=2.0, file_kg=None, seed=0):
    """Somebody of 80 kg who sways by some millimetres, or walks at a speed.

    ``loads_n`` is what both plates measure at given times, by default half of the weight each.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(round(100 * duration_s)) / 100
    analog = np.arange(round(1000 * duration_s)) / 1000
    sway = 0.004 * np.sin(2 * np.pi * 0.3 * time)[:, None, None]
    place = rng.normal(size=(1, len(NAMES), 3)) + sway * [1, 1, 0]
    place = place + speed_mps * time[:, None, None] * [1, 0, 0]
    place = place + rng.normal(scale=0.0003, size=place.shape)
    loads = loads_n(analog) if loads_n else (WEIGHT_N / 2 + 0 * analog,) * 2
    plates = []
    for number, load in enumerate(loads, 1):
        wrench = np.zeros((len(analog), 6))
        wrench[:, 2] = load + rng.normal(scale=noise_n, size=len(analog))
        plates.append(Plate.at_origin(number, analog, wrench))
    return Recording(
        "stand.c3d", Markers(time, NAMES, place), tuple(plates), metadata=Metadata(mass_kg=file_kg)
    )


def late(plate, begin_s, rest_n=0.0):
    """Loads of two plates of which one rests until it begins to measure."""

    def loads(time):
        whole = [WEIGHT_N / 2 + 0 * time] * 2
        whole[plate] = np.where(time < begin_s, rest_n, whole[plate])
        return whole

    return loads


def without_plates(recording):
    return replace(recording, plates=())
