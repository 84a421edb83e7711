"""What may be wrong with the pose of a moving platform: its delay, size, zero, axes and pivot."""

from collections.abc import Iterator
from functools import partial

import numpy as np

from compensation import PlatformPose, interpolate_pose
from compensation.platform import LEFT
from hbm.spatial import Array, rotation_about
from pipeline.config.schema import Platform
from pipeline.explain.cause import Cause, Change
from pipeline.explain.priors import priors
from pipeline.explain.processing_chain import ProcessingChain

UP = np.array([0.0, 0.0, 1.0])


def platform_causes(chain: ProcessingChain, platform: Platform | None) -> Iterator[Cause]:
    """Give what may be wrong with the platform's pose in a trial.

    Parameters
    ----------
    chain
        The trial.
    platform
        How the pose is known, as the study states it; None for a treadmill that stands still.

    Yields
    ------
    Cause
        Of markers: zero of sway and pitch. Of channels: these, delay, size of sway and pitch, and
        direction of the axis about the vertical; where there is pitch, the place of its axis too.
        Nothing where the platform stands still.
    """
    if chain.pose is None or platform is None:
        return
    known, kind = priors(), "marker" if platform.markers else "channel"
    zeros: tuple[tuple[str, Change], ...] = (("sway", _sway), ("pitch", _pitch))
    for name, change in zeros:
        prior = known[f"{kind}_{name}_zero"]
        yield Cause(f"platform: zero of {name}", "platform", prior, change)
    if platform.markers:
        return
    moving: list[tuple[str, str, Change]] = [("late", "pose_delay", _late)]
    if platform.sway_channel:
        moving.append(("size of sway", "pose_size", _larger_sway))
    if platform.pitch_channel:
        moving.append(("size of pitch", "pose_size", _larger_pitch))
        moving += [
            (f"pivot along {letter}", "pivot", partial(_pivot, along=axis))
            for letter, axis in (("x", np.eye(3)[0]), ("z", UP))
        ]
    moving.append(("direction about z", "pose_direction", _turned))
    for title, kind, change in moving:
        yield Cause(f"platform: {title}", "platform", known[kind], change, of_platform=True)


def _late(chain: ProcessingChain, delay_s: float) -> ProcessingChain:
    """Make the pose later [s]; the ends are held, gaps stay where they are."""
    pose = _pose(chain)
    known = chain.time[np.flatnonzero(np.isfinite(pose.position).all(axis=1))]
    later = interpolate_pose(pose, chain.time, np.clip(chain.time - delay_s, known[0], known[-1]))
    gap = np.asarray(np.isnan(later.position + pose.position).any(axis=1, keepdims=True))
    return _with_pose(
        chain,
        np.where(gap[:, None], pose.rotation, later.rotation),
        np.where(gap, pose.position, later.position),
    )


def _sway(chain: ProcessingChain, size: float) -> ProcessingChain:
    """Take the platform to be farther to the left [m]."""
    pose = _pose(chain)
    return _with_pose(chain, pose.rotation, pose.position + size * LEFT)


def _pitch(chain: ProcessingChain, size: float) -> ProcessingChain:
    """Take the platform to be pitched farther [rad], about a lateral axis under the person."""
    pose = _pose(chain)
    center = np.mean([plate.center for plate in chain.plates], axis=0)
    turn = rotation_about(LEFT, size)
    return _with_pose(
        chain, pose.rotation @ turn, pose.position + pose.rotation @ (center - turn @ center)
    )


def _larger_sway(chain: ProcessingChain, share: float) -> ProcessingChain:
    """Take the platform to sway by a share farther."""
    pose = _pose(chain)
    return _with_pose(chain, pose.rotation, pose.position + share * pose.position * LEFT)


def _larger_pitch(chain: ProcessingChain, share: float) -> ProcessingChain:
    """Take the platform to pitch by a share farther, about the axis that its pose shows."""
    pose = _pose(chain)
    turn = rotation_about(LEFT, share * pose.pitch)
    sway = pose.position * LEFT
    return _with_pose(chain, pose.rotation @ turn, sway + _along(pose, turn))


def _along(pose: PlatformPose, turn: Array) -> Array:
    """Give the positions in the plane of pitch with a further turn about the axis, (T, 3) [m].

    The position there is ``p - R p``: the point ``p`` of the axis is found from all frames.
    """
    plane = [0, 2]
    known = np.isfinite(pose.position).all(axis=1)
    still = np.eye(3) - pose.rotation
    rows = still[known][:, plane][:, :, plane].reshape(-1, 2)
    point = np.zeros(3)
    point[plane] = np.linalg.lstsq(rows, pose.position[known][:, plane].ravel())[0]
    return point - pose.rotation @ turn @ point


def _turned(chain: ProcessingChain, angle: float) -> ProcessingChain:
    """Take the platform's axes of motion to be turned about the vertical [rad]."""
    pose, turn = _pose(chain), rotation_about(UP, angle)
    return _with_pose(chain, turn @ pose.rotation @ turn.T, pose.position @ turn.T)


def _pivot(chain: ProcessingChain, size: float, *, along: Array) -> ProcessingChain:
    """Take the axis of pitch to be where it is not, by a size [m] along a direction."""
    pose = _pose(chain)
    moved = pose.position + size * (along - pose.rotation @ along)
    return _with_pose(chain, pose.rotation, moved)


def _pose(chain: ProcessingChain) -> PlatformPose:
    assert chain.pose is not None  # there are no causes else
    return chain.pose


def _with_pose(chain: ProcessingChain, rotation: Array, position: Array) -> ProcessingChain:
    return chain.with_wrenches(chain.wrenches, PlatformPose(rotation, position))
