"""What may be wrong with markers: where they sit, skin that carries them, arms that have none."""

from collections.abc import Iterator, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import partial
from typing import Final

import numpy as np

from hbm.coordinates import INDEX, LIMBS, MOVING, SIDES
from hbm.kinematics import solve_ik
from hbm.markers import Markers
from hbm.poses import segment_frames
from hbm.signals.filtering import Filtered, butterworth
from hbm.spatial import Array, Indices
from pipeline.explain.cause import Cause, CauseGroup, Prior, priors
from pipeline.explain.processing_chain import ProcessingChain

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
DECREASE: Final = 1.5
"""Harmonic h is as large as the first by h to minus this power; those of the hip's angle fall
faster, those of the ankle's more slowly."""
STEP: Final = 0.001
"""Displacement that the inverse kinematics is linearised by [m or rad]."""


@dataclass(frozen=True, slots=True, eq=False)
class Displacement:
    """Markers of a segment displaced together, and what the inverse kinematics makes of it.

    Attributes
    ----------
    columns
        Columns of the markers, (K,); none where coordinates change that no marker shows.
    position
        Displacement of each per unit, (T, K, 3) [m per m or rad].
    q
        Change of the coordinates per unit, (T, 46).
    """

    columns: Indices
    position: Array
    q: Array


@dataclass(frozen=True, slots=True, eq=False)
class MarkerCause(Cause):
    """Markers that are displaced in the course of time.

    Attributes
    ----------
    displacement
        Which markers, where to, and the coordinates with them.
    course
        Its course over time, (T,).
    """

    _: KW_ONLY
    displacement: Displacement
    course: Array

    def effect(self, chain: ProcessingChain) -> Array:
        """Give the residual that it adds per unit of its size, as for every cause.

        The change of the coordinates is filtered once, which is the same, the filter being linear.
        """
        step = self.prior.size * self.course[:, None] * self.displacement.q
        settings = chain.settings
        change = butterworth(step, chain.time, settings.cutoff_hz, settings.filter)
        more, less = (_with_motion(chain, change, sign).residual for sign in (1, -1))
        return np.asarray((more - less) / (2 * self.prior.size))


def marker_causes(
    chain: ProcessingChain, spans: Sequence[tuple[float, float]] | Array
) -> Iterator[Cause]:
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
        the thorax also turns about its long axis. Arms without markers hang elsewhere and swing.

    Notes
    -----
    Of what the skin does to the markers of a segment, displacements of all of them together are
    most (Barré et al. 2017, J Biomech 62:21), and only they move the segment. Turns change the
    residuals little (but for that of the thorax about its long axis, which no displacement does),
    and so does the skin of shanks, feet, head and arms: they belong to what no cause describes, as
    does what differs between cycles.
    """
    phase = 2 * np.pi * cycle_phase(chain.time, spans)
    frames = segment_frames(chain.body, chain.q)
    for segment in CLUSTERS:
        columns = _columns(chain, segment)
        if len(columns):
            rotation, origin = (own[:, MOVING.index(segment)] for own in frames)
            yield from _of_cluster(chain, segment, columns, rotation, origin, phase)
    for side, letter in SIDES.items():
        if not any(len(_columns(chain, segment)) for segment in LIMBS[f"{side} arm"][1:]):
            q = np.zeros_like(chain.q)
            q[:, INDEX[f"{letter}ShoulderFlexion"]] = 1.0
            unseen = Displacement(np.array([], int), np.zeros((len(q), 0, 3)), q)
            name, prior = f"{side} arm without markers: flexion", priors()["unseen_arm"]
            yield _cause(name, "markers", prior, unseen, np.ones(len(q)))
            yield from _series(name, "markers", prior, unseen, phase)


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
    missing = np.append(0, np.round((start[1:] - stop[:-1]) / duration))
    number = np.arange(len(start)) + np.cumsum(missing)
    knots = np.column_stack([start, stop]).ravel()
    inside = np.interp(time, knots, np.column_stack([number, number + 1]).ravel())
    beyond = np.minimum(time - knots[0], 0) + np.maximum(time - knots[-1], 0)
    return np.asarray(inside + beyond / duration)


def _of_cluster(
    chain: ProcessingChain,
    segment: str,
    columns: Indices,
    rotation: Array,
    origin: Array,
    phase: Array,
) -> Iterator[MarkerCause]:
    """Give what may be wrong with a segment's markers, by its orientation and origin."""
    known, name = priors(), segment.replace("_", " ")
    lever = chain.markers.position[:, columns] - origin[:, None]
    for axis, letter in zip(np.moveaxis(rotation, 2, 0), "xyz", strict=True):
        moved = _displacement(chain, columns, np.broadcast_to(axis[:, None], lever.shape))
        title = f"{name}: markers' place along {letter}"
        yield _cause(title, "markers", known["marker_place"], moved, np.ones(len(phase)))
        if segment in ON_SKIN:
            prior = known[f"skin_{segment.split('_')[-1]}"]
            yield from _series(f"{name}: skin along {letter}", "skin", prior, moved, phase)
    if segment == "thorax":
        turned = _displacement(chain, columns, np.cross(rotation[:, None, :, 2], lever))
        yield from _series(f"{name}: skin about z", "skin", known["skin_turn"], turned, phase)


def _series(
    name: str, group: CauseGroup, first: Prior, moved: Displacement, phase: Array
) -> Iterator[MarkerCause]:
    """Give the terms of a Fourier series, whose first harmonic has a prior."""
    for h in range(1, HARMONICS + 1):
        prior = replace(first, size=first.size / h**DECREASE)
        for wave, course in (("sine", np.sin(h * phase)), ("cosine", np.cos(h * phase))):
            yield _cause(f"{name}, {wave} {h} a cycle", group, prior, moved, course)


def _cause(
    name: str, group: CauseGroup, prior: Prior, moved: Displacement, course: Array
) -> MarkerCause:
    change = partial(_displaced, by=moved, course=course)
    return MarkerCause(name, group, prior, change, displacement=moved, course=course)


def _columns(chain: ProcessingChain, segment: str) -> Indices:
    """Give the columns of a segment's markers."""
    own = zip(chain.body.markers, chain.body.marker_segment, strict=True)
    names = [name for name, on in own if on == segment and name in chain.markers.names]
    return np.array([chain.markers.names.index(name) for name in names], int)


def _displacement(chain: ProcessingChain, columns: Indices, position: Array) -> Displacement:
    """Find what the inverse kinematics makes of markers that are displaced, (T, K, 3) per unit."""
    markers = _with_displaced(chain.markers, columns, STEP * position)
    q = (solve_ik(chain.body, markers).q - chain.q) / STEP
    return Displacement(columns, position, q)


def _displaced(
    chain: ProcessingChain, size: float, *, by: Displacement, course: Array
) -> ProcessingChain:
    """Displace markers over time, and the coordinates as the inverse kinematics would."""
    step = size * course
    markers = _with_displaced(chain.markers, by.columns, step[:, None, None] * by.position)
    return chain.changed(markers=markers, q=chain.q + step[:, None] * by.q)


def _with_displaced(markers: Markers, columns: Indices, by: Array) -> Markers:
    position = markers.position.copy()
    position[:, columns] += by
    return Markers(markers.time, markers.names, position)


def _with_motion(chain: ProcessingChain, change: Filtered, sign: int) -> ProcessingChain:
    """Add a filtered change of the coordinates, or take it away."""
    own = chain.motion
    motion = Filtered(
        own.value + sign * change.value,
        own.velocity + sign * change.velocity,
        own.acceleration + sign * change.acceleration,
    )
    return chain.with_motion(motion)
