"""Checks of a body against common sense."""

from typing import Final

import numpy as np

from hbm.coordinates import SIDES
from hbm.model import Body
from hbm.notes import Note

MAX_LEG_DIFFERENCE_M: Final = 0.03
"""True differences rarely exceed 2 cm; a misplaced marker easily causes more."""


def implausible(body: Body) -> tuple[Note, ...]:
    """Find what is implausible about a body.

    Parameters
    ----------
    body
        The subject.

    Returns
    -------
    tuple of Note
        ``legs_differ`` by more than 3 cm.

    Examples
    --------
    With ``body`` from `build_body`:

    >>> import hbm
    >>> hbm.implausible(body)
    ()
    """
    legs = {side: _leg_length(body, side) for side in SIDES}
    difference = abs(legs["left"] - legs["right"])
    if difference <= MAX_LEG_DIFFERENCE_M:
        return ()
    return (
        Note.of("legs_differ", difference_m=difference, left_m=legs["left"], right_m=legs["right"]),
    )


def _leg_length(body: Body, side: str) -> float:
    return sum(float(np.linalg.norm(body.offsets[f"{side}_{s}"])) for s in ("shank", "foot"))
