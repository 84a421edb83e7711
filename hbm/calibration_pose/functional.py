"""Functional calibration: hip centres from a trial in which the thighs swing."""

from typing import Final

import numpy as np

from hbm.calibration_pose.landmarks import pelvis_frame
from hbm.markers import Markers, MarkerSet, recognise_marker_set
from hbm.numbers import read_numbers
from hbm.spatial import Array, fit_rotation

LIMITS: Final = read_numbers("hbm", "thresholds.toml", "calibration_pose")


def functional_hips(markers: Markers, marker_set: MarkerSet | None = None) -> dict[str, Array]:
    """Find the hip centres about which the thighs rotate.

    Parameters
    ----------
    markers
        A trial in which each thigh swings in more than one plane: star and arc movements, or a
        walk with enough ab-/adduction. Frames with gaps in a cluster are left out.
    marker_set
        Segments of the markers; by default recognised from the labels.

    Returns
    -------
    dict[str, Array]
        "right" and "left" -> centre in the pelvis frame (origin mid-ASIS, forward, left, up),
        (3,) [m], as `build_body` takes it for ``hip``.

    Raises
    ------
    ValueError
        If a cluster has fewer than three markers, or a thigh rotates too little or in one plane.

    Notes
    -----
    Symmetrical centre of rotation estimation (Ehrig et al. 2006, J Biomech 39:2798): pelvis and
    thigh are rigid clusters with poses (R, o) and (S, p), and the centre is fixed in both: the
    least-squares solution of R c + o = S d + p. The result is the mean of both clusters' centres.

    Examples
    --------
    Both legs of ``body``, built by `build_body`, swing forward, back and sideways:

    >>> import hbm, numpy as np
    >>> from hbm.poses import marker_positions
    >>> time = np.arange(400) / 100
    >>> q = np.zeros((400, 46))
    >>> for side in "RL":
    ...     q[:, hbm.COORDINATES.index(f"{side}HipFlexion")] = 0.5 * np.sin(4 * time)
    ...     q[:, hbm.COORDINATES.index(f"{side}HipAbduction")] = 0.4 * np.sin(3 * time) ** 2
    >>> hips = hbm.functional_hips(hbm.Markers(time, body.markers, marker_positions(body, q)))
    >>> [f"{1000 * x:.0f} mm" for x in hips["left"]]
    ['-66 mm', '104 mm', '-86 mm']
    """
    chosen = (marker_set or recognise_marker_set(markers.names)).present(markers.names)
    hips = {}
    for side in ("right", "left"):
        pelvis, thigh = (_cluster(markers, chosen, s) for s in ("pelvis", f"{side}_thigh"))
        complete = ~np.isnan(pelvis[1]).any(axis=(1, 2)) & ~np.isnan(thigh[1]).any(axis=(1, 2))
        if complete.sum() < 3:
            raise ValueError(
                f"functional hips: no three frames show all of {', '.join(pelvis[0] + thigh[0])}"
            )
        shape, R, o = _poses(pelvis[1][complete])
        _, S, p = _poses(thigh[1][complete])
        # the pelvis frame in the axes of its cluster, from landmarks of the mean shape
        shape_of = dict(zip(pelvis[0], shape, strict=True))
        at = {mark: shape_of[name] for mark, name in chosen.landmark.items() if name in shape_of}
        axes, origin, _, _ = pelvis_frame(at)
        # the centre of rotation in the pelvis frame, as hip rules give it
        hips[side] = axes.T @ (_center(R, o, S, p, side) - origin)
    return hips


def _cluster(markers: Markers, chosen: MarkerSet, segment: str) -> tuple[list[str], Array]:
    segment_of = chosen.segment
    names = [n for n in markers.names if segment_of.get(n) == segment]
    if len(names) < 3:
        raise ValueError(
            f"functional hips need three markers on the {segment}, got {', '.join(names) or 'none'}"
        )
    return names, markers.position[:, [markers.names.index(n) for n in names]]


def _poses(position: Array) -> tuple[Array, Array, Array]:
    """Give a cluster's mean shape about its centroid, its orientation and centroid over time."""
    centroid = position.mean(axis=1)
    centred = position - centroid[:, None]
    shape = centred[0]
    # the error is 2e-7 m after the first time and falls ten thousandfold each time
    for _ in range(3):
        # shape and poses in turn (generalised Procrustes, without scaling)
        R = fit_rotation(np.einsum("tki,kj->tij", centred, shape))
        shape = np.einsum("tij,tki->kj", R, centred) / len(R)
    return shape, R, centroid


def _center(R: Array, o: Array, S: Array, p: Array, side: str) -> Array:
    """Give the centre of rotation in the first cluster's frame."""
    # R c + o = S d + p in every frame: c in the pelvis, d in the thigh (Ehrig et al. 2006)
    system = np.concatenate([R, -S], axis=2).reshape(-1, 6)
    smallest = np.linalg.svd(system, compute_uv=False)[-1] / np.sqrt(len(R))
    if smallest < LIMITS.least_singular_value:
        raise ValueError(
            f"the {side} thigh rotates too little, or in one plane only, to show its hip centre; "
            "swing it forward, back and sideways by at least 30°"
        )
    both = np.linalg.lstsq(system, (p - o).ravel(), rcond=None)[0]
    c, d = both[:3], both[3:]
    # the thigh's centre as the pelvis sees it, averaged with the pelvis' own
    from_thigh = np.einsum("tji,tj->ti", R, (S @ d) + p - o).mean(axis=0)
    return np.asarray((c + from_thigh) / 2)
