"""Whether two engines agree on the dynamics of the same frames."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from hbm.coordinates import COORDINATES, TREE
from hbm.spatial import WRENCH_COMPONENTS, Array, Indices, Mask

CHECKED_FRAMES: Final = 16
MAX_DIFFERENCE: Final = 1e-8
"""As a share of the frame's largest force or moment: far above rounding (1e-13), far below what a
wrong number in the equations would cause."""
SMALLEST_SCALE: Final = 1.0
"""A frame's largest force or moment counts as at least 1 N or 1 N·m: in free fall all vanish."""

NAMES: Final = (*COORDINATES, *(f"residual {axis}" for axis in WRENCH_COMPONENTS))
IS_FORCE: Final[Mask] = np.array([c.translates for c in TREE] + 3 * [True] + 3 * [False])


def frames_to_check(forces: Sequence[Array]) -> Indices:
    """Choose frames that are spread over those in which all forces, (T, 52) each, are defined."""
    defined = np.flatnonzero(np.isfinite(sum(of_one.sum(axis=1) for of_one in forces)))
    spread = np.linspace(0, len(defined) - 1, min(CHECKED_FRAMES, len(defined)))
    return np.asarray(defined[np.round(spread).astype(int)])


def require_agreement(
    one: Array, other: Array, engines: tuple[str, str], frames: Indices, time: Array
) -> float:
    """Compare the forces that two engines found for the same frames.

    Parameters
    ----------
    one, other
        46 generalized forces, then the residual, (F, 52) [N and N·m] each.
    engines
        What to call the one and the other.
    frames, time
        Numbers and times of the frames in the motion, (F,).

    Returns
    -------
    float
        The largest difference, as a share of the frame's largest force or moment.

    Raises
    ------
    ValueError
        If it exceeds `MAX_DIFFERENCE`.
    """
    share = np.empty_like(one)
    for own in (IS_FORCE, ~IS_FORCE):
        size = np.maximum(np.abs(one[:, own]), np.abs(other[:, own])).max(axis=1, keepdims=True)
        share[:, own] = np.abs(one - other)[:, own] / np.maximum(size, SMALLEST_SCALE)
    share = np.where(np.isnan(share), np.inf, share)
    row, column = np.unravel_index(share.argmax(), share.shape)
    largest = float(share[row, column])
    if largest > MAX_DIFFERENCE:
        unit = "N" if IS_FORCE[column] else "N·m"
        found = ", ".join(
            f"{forces[row, column]:.9g} {unit} by {engine}"
            for forces, engine in zip((one, other), engines, strict=True)
        )
        raise ValueError(
            f"the two engines of inverse dynamics disagree: frame {frames[row]} ({time[row]:.3f} "
            f"s), {NAMES[column]}: {found}; they differ by {largest:.1e} of the frame's largest, "
            f"more than {MAX_DIFFERENCE:g}, so that neither can be trusted; run 'hbm doctor' and "
            "report what it prints"
        )
    return largest
