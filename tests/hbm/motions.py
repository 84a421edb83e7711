"""Motions whose coordinates, rates and accelerations are known exactly."""

import numpy as np

from hbm.coordinates import INDEX, TREE, N
from hbm.markers import Markers
from hbm.motion import Motion
from hbm.poses import marker_positions

SLIDES = np.array([c.translates for c in TREE])


def swinging(rng, frames=40, rate_hz=100.0, degrees=40.0):
    """Every coordinate swings sinusoidally in its own time while the person travels."""
    time = np.arange(frames) / rate_hz
    size = np.where(SLIDES, 0.03, np.radians(degrees)) * rng.uniform(0.3, 1, N)
    rate, phase = 2 * np.pi * rng.uniform(0.3, 1.8, N), rng.uniform(0, 2 * np.pi, N)
    angle = np.outer(time, rate) + phase
    q, v, a = size * np.sin(angle), size * rate * np.cos(angle), -size * rate**2 * np.sin(angle)
    q[:, INDEX["PelvisX"]] += 1.3 * time
    v[:, INDEX["PelvisX"]] += 1.3
    q[:, INDEX["PelvisZ"]] += 0.95
    return motion_of(time, q, v, a)


def motion_of(time, q, v, a):
    """Coordinates that nobody measured, as a Motion."""
    frames = len(time)
    seen = np.ones((frames, N), bool)
    return Motion(time, q, v, a, (), np.zeros((frames, 0)), np.ones(frames, bool), seen)


def markers_of(body, motion):
    """Markers that ride exactly on the model."""
    return Markers(motion.time, body.markers, marker_positions(body, motion.q))
