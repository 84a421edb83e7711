"""What may be wrong with markers: where they sit, skin that carries them, parts that have none."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Final, NamedTuple

import numpy as np

from hbm.coordinates import FORWARD, INDEX, LEFT, LIMBS, MOVING, N_Q, SIDES, UP
from hbm.ik.start import three_angles
from hbm.ik.tracking import solve_ik
from hbm.ik.upright import TRUNK
from hbm.markers import Markers
from hbm.poses import segment_frames
from hbm.spatial import Array, rotation_about
from pipeline.explain.cause import Cause, Prior, priors
from pipeline.trial.chain import Chain

CLUSTERS: Final = (
    *("pelvis", "thorax", "head"),
    *(f"{side}_{segment}" for segment in ("thigh", "shank") for side in SIDES),
)
"""Segments whose markers may sit elsewhere: on feet and arms, the usual 5 mm change no residual of
a walk by a twentieth of its RMS."""
ON_SKIN: Final = ("pelvis", "thorax", "right_thigh", "left_thigh")
"""Segments whose skin counts: a harmonic of the usual size on the shanks changes no residual by
more than 6 %, on feet and arms by less."""
HARMONICS: Final = 4
"""Of the gait cycle: joint angles, which the skin follows (Bonci et al. 2014, J Biomech 47:2354),
have less than a twentieth of their variance above."""
BELOW_TRUNK: Final = ("pelvis", *LIMBS["right leg"], *LIMBS["left leg"])
STEP: Final = 0.001
"""Displacement that the inverse kinematics is linearised by [m or rad]."""


def marker_causes(chain: Chain, spans: Sequence[tuple[float, float]] | Array) -> Iterator[Cause]:
    """Give what may be wrong with the markers of a trial.

    Parameters
    ----------
    chain
        The trial.
    spans
        Start and stop of the gait cycles of one side, (C, 2) [s].

    Yields
    ------
    Cause
        Per segment and axis: its markers are displaced together against the calibration pose, and
        the skin displaces them in the course of the gait cycle, as a Fourier series; the skin of
        the thorax also turns about its long axis. A trunk without markers leans, bends and twists,
        arms without them hang elsewhere and swing.

    Notes
    -----
    Of what the skin does to the markers of a segment, displacements of all of them together are
    most (Barré et al. 2017, J Biomech 62:21), and only they move the segment. Turns change the
    residuals little (but for that of the thorax about its long axis, which no displacement does),
    and so does the skin of shanks, feet, head and arms: they belong to what no cause describes, as
    does what differs between cycles.
    """
    phase, prior_of = 2 * np.pi * cycle_phase(chain.time, spans), priors()
    throughout = np.ones(len(phase))
    frames = segment_frames(chain.body, chain.q)
    for segment in CLUSTERS:
        columns = _columns(chain, segment)
        if not columns:
            continue
        name = segment.replace("_", " ")
        rotation, origin = (values[:, MOVING.index(segment)] for values in frames)
        # from the segment's origin, in lab axes
        lever = chain.markers.position[:, columns] - origin[:, None]
        for axis, letter in zip(np.moveaxis(rotation, 2, 0), "xyz", strict=True):
            moved = _displacement(chain, columns, np.broadcast_to(axis[:, None], lever.shape))
            title = f"{name}: markers' place along {letter}"
            yield _cause(title, "markers", prior_of["marker_place"], moved, throughout)
            if segment in ON_SKIN:
                prior = prior_of[f"skin_{segment.split('_')[-1]}"]
                yield from _series(f"{name}: skin along {letter}", "skin", prior, moved, phase)
        if segment == "thorax":
            # a small turn about the long axis moves each marker by axis × lever
            turned = _displacement(chain, columns, np.cross(rotation[:, None, :, 2], lever))
            prior = prior_of["skin_turn"]
            yield from _series(f"{name}: skin about z", "skin", prior, turned, phase)
    # a part without markers moves coordinates, but no marker
    for group, name, kind, q in _unseen(chain, frames[0]):
        moved = _Moved(q, lambda markers, step: markers)
        yield _cause(name, group, prior_of[kind], moved, throughout)
        yield from _series(name, group, prior_of[kind], moved, phase)


class _Moved(NamedTuple):
    """What a displacement per unit does: to coordinates, (T, 46), and, by a step, to markers."""

    q: Array
    markers: Callable[[Markers, Array], Markers]


def _cause(name: str, group: str, prior: Prior, moved: _Moved, course: Array) -> Cause:
    """Give the cause that coordinates, and markers with them, are displaced in a course, (T,)."""
    along = course[:, None]

    def change(of: Chain, size: float) -> Chain:
        step = size * along
        return of.changed(markers=moved.markers(of.markers, step), q=of.q + step * moved.q)

    return Cause(name, group, prior, change, moves=(along, moved.q))


def cycle_phase(time: Array, spans: Sequence[tuple[float, float]] | Array) -> Array:
    """Give the phase of the gait cycle.

    Parameters
    ----------
    time
        Frame times, (T,) [s].
    spans
        Start and stop of the cycles of one side, in order, (C, 2) [s].

    Returns
    -------
    Array
        In cycles since the first start, (T,): whole at every start and stop. Before, after and
        between the cycles others of median duration are assumed.

    Examples
    --------
    >>> phase = cycle_phase(np.array([-0.5, 0.0, 0.6, 1.6, 2.5]), [(0.0, 1.2), (1.2, 2.0)])
    >>> phase.round(3).tolist()
    [-0.5, 0.0, 0.5, 1.5, 2.5]
    """
    start, stop = np.transpose(spans)
    duration = np.median(stop - start)
    # a gap between two cycles holds a whole number of cycles that were not found
    missing = np.append(0, np.round((start[1:] - stop[:-1]) / duration))
    number = np.arange(len(start)) + np.cumsum(missing)
    # linear within each cycle and gap, of median speed beyond the first and the last
    knots = np.column_stack([start, stop]).ravel()
    inside = np.interp(time, knots, np.column_stack([number, number + 1]).ravel())
    beyond = np.minimum(time - knots[0], 0) + np.maximum(time - knots[-1], 0)
    return np.asarray(inside + beyond / duration)


def _series(name: str, group: str, first: Prior, moved: _Moved, phase: Array) -> Iterator[Cause]:
    """Give the terms of a Fourier series of a displacement: as measured, or by its first one."""
    # between the hip's angle, whose harmonics fall faster, and the ankle's, of which they do slower
    decreasing = tuple(first.size / h**1.5 for h in range(1, HARMONICS + 1))
    for h, size in enumerate(first.harmonics or decreasing, start=1):
        prior = replace(first, size=size, usual=size)
        for wave, course in (("sine", np.sin(h * phase)), ("cosine", np.cos(h * phase))):
            yield _cause(f"{name}, {wave} {h} a cycle", group, prior, moved, course)


def _unseen(chain: Chain, rotation: Array) -> Iterator[tuple[str, str, str, Array]]:
    """Give group, name, kind of prior and change of q per radian, (T, 46), of what is not shown."""
    segment_of = chain.body.segment_of
    marked = {segment_of[name] for name in chain.markers.names if name in segment_of}
    if marked <= {*BELOW_TRUNK}:
        # head and arms follow the trunk, which turns about the lumbar joint
        pelvis, thorax = (rotation[:, MOVING.index(name)] for name in ("pelvis", "thorax"))
        carried = pelvis.transpose(0, 2, 1) @ thorax
        for name, axis in {"bend": FORWARD, "lean": LEFT, "twist": UP}.items():
            # about an axis of the thorax: what the three lumbar angles change by per radian
            q = np.zeros((len(carried), N_Q))
            more, less = (carried @ rotation_about(axis, step) for step in (STEP, -STEP))
            angles = [three_angles(turned, TRUNK.start) for turned in (more, less)]
            q[:, TRUNK] = np.subtract(*angles) / (2 * STEP)
            yield "unseen_trunk", f"trunk without markers: {name}", f"unseen_{name}", q
    for side, letter in SIDES.items():
        if marked.isdisjoint(LIMBS[f"{side} arm"][1:]):
            q = np.zeros((len(rotation), N_Q))
            q[:, INDEX[f"{letter}ShoulderFlexion"]] = 1.0
            yield "unseen_arms", f"{side} arm without markers: flexion", "unseen_arm", q


def _columns(chain: Chain, segment: str) -> list[int]:
    """Give the columns of a segment's markers."""
    names, segment_of = chain.markers.names, chain.body.segment_of
    return [names.index(n) for n in chain.body.markers if n in names and segment_of[n] == segment]


def _displacement(chain: Chain, columns: Sequence[int], position: Array) -> _Moved:
    """Give what displaced markers do, (T, K, 3) [m per m or rad].

    The coordinates follow in proportion, as the inverse kinematics makes them follow a small one,
    from those of the chain. Sizes agree with those from other starts to 1e-8 of their deviations.
    """
    displaced = partial(_with_displaced, columns=columns, by=position)
    q = solve_ik(chain.body, displaced(chain.markers, STEP), near=chain.q).q
    return _Moved((q - chain.q) / STEP, displaced)


def _with_displaced(
    markers: Markers, step: Array | float, *, columns: Sequence[int], by: Array
) -> Markers:
    """Give trajectories of which some columns are displaced, (T, K, 3) [m] times a step, (T, 1)."""
    position = markers.position.copy()
    position[:, columns] += np.atleast_1d(step)[:, None] * by
    return Markers(markers.time, markers.names, position)
