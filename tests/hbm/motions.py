"""Motions whose coordinates, rates and accelerations are known exactly."""

import numpy as np

from hbm.coordinates import INDEX, N_Q, TREE
from hbm.markers import Markers
from hbm.motion import Motion
from hbm.poses import marker_positions

TRANSLATIONS = np.array([c.translates for c in TREE])


def swinging(rng, frames=40, rate_hz=100.0, degrees=40.0):
    """Every coordinate oscillates at its own frequency while the person moves forward."""
    time = np.arange(frames) / rate_hz
    size = np.where(TRANSLATIONS, 0.03, np.radians(degrees)) * rng.uniform(0.3, 1, N_Q)
    rate, phase = 2 * np.pi * rng.uniform(0.3, 1.8, N_Q), rng.uniform(0, 2 * np.pi, N_Q)
    angle = np.outer(time, rate) + phase
    q, v, a = size * np.sin(angle), size * rate * np.cos(angle), -size * rate**2 * np.sin(angle)
    q[:, INDEX["PelvisX"]] += 1.3 * time
    v[:, INDEX["PelvisX"]] += 1.3
    q[:, INDEX["PelvisZ"]] += 0.95
    return motion_of(time, q, v, a)


def motion_of(time, q, v, a):
    """A Motion of given coordinates, without markers."""
    frames = len(time)
    seen = np.ones((frames, N_Q), bool)
    return Motion(time, q, v, a, (), np.zeros((frames, 0)), np.ones(frames, bool), seen)


def markers_of(body, motion):
    """Markers exactly where the model has them."""
    return Markers(motion.time, body.markers, marker_positions(body, motion.q))


def with_noise(markers, rng, size_m):
    """The same markers with Gaussian noise."""
    noise = rng.normal(scale=size_m, size=markers.position.shape)
    return Markers(markers.time, markers.names, markers.position + noise)


def without(markers, names, frames=slice(None)):
    """The same markers, some of them missing in some frames."""
    position = markers.position.copy()
    for name in names:
        position[frames, markers.names.index(name)] = np.nan
    return Markers(markers.time, markers.names, position)


def displaced(markers, name, offset_m, frames=slice(None)):
    """The same markers, one of them elsewhere in some frames."""
    position = markers.position.copy()
    position[frames, markers.names.index(name)] += offset_m
    return Markers(markers.time, markers.names, position)


def held(markers, frames, names=None):
    """The same markers, some of them held at the first of these frames."""
    position = markers.position.copy()
    own = [markers.names.index(name) for name in names or markers.names]
    position[frames, own] = position[frames.start, own]
    return Markers(markers.time, markers.names, position)


def relabelled(markers, *pairs):
    """The same markers, the labels of each pair exchanged throughout."""
    other = {a: b for pair in pairs for a, b in (pair, pair[::-1])}
    names = tuple(other.get(name, name) for name in markers.names)
    return Markers(markers.time, names, markers.position)


def exchanged(markers, frames, *pairs):
    """The same markers, the labels of each pair exchanged in some frames."""
    position = markers.position.copy()
    for pair in pairs:
        own = [markers.names.index(name) for name in pair]
        position[frames, own] = position[frames, own[::-1]]
    return Markers(markers.time, markers.names, position)


def any_pose(rng, frames):
    """Unrelated random poses: facing anywhere, arms anywhere, within the joints' ranges."""
    ranges = {
        "PelvisYaw": (-180, 180), "PelvisForwardPitch": (-20, 30), "PelvisRightRoll": (-15, 15),
        "TrunkFlexion": (-20, 50), "TrunkRightBend": (-25, 25), "TrunkLeftTwist": (-35, 35),
        "HeadFlexion": (-40, 40), "HeadRightBend": (-35, 35), "HeadLeftTwist": (-70, 70),
        "ShoulderAbduction": (-180, 180), "ShoulderFlexion": (-85, 85),
        "ShoulderInternalRotation": (-180, 180), "ElbowFlexion": (-5, 145),
        "ForeArmPronation": (-10, 170), "WristFlexion": (-70, 70), "HandAbduction": (-30, 30),
        "HipFlexion": (-30, 80), "HipAbduction": (-20, 40), "HipInternalRotation": (-40, 40),
        "KneeFlexion": (-5, 110), "AnklePlantarFlexion": (-30, 45), "FootPronation": (-25, 25),
    }  # fmt: skip
    q = np.zeros((frames, N_Q))
    for name, i in INDEX.items():
        if name in ranges or name[1:] in ranges:
            low, high = ranges.get(name, ranges.get(name[1:]))
            q[:, i] = np.radians(rng.uniform(low, high, frames))
        elif TRANSLATIONS[i]:
            q[:, i] = rng.uniform(-0.03, 0.03, frames)
    q[:, :3] += rng.uniform([-3, -1, 0.7], [3, 1, 1.1], (frames, 3))
    return motion_of(np.arange(frames) / 100, q, q, q)
