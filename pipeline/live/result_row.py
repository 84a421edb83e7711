"""A frame's results as one row of numbers, for the outlet and on disk."""

from typing import Final

import numpy as np

from hbm.spatial import Array
from pipeline.live.frames.frame import LiveFrame
from pipeline.live.outlet import result_channels

UNKNOWN: Final = np.full(6, np.nan)
TIME: Final = "time_s"


def result_columns() -> tuple[str, ...]:
    """Name the numbers of a row on disk: its time, then the channels of the stream of results."""
    return (TIME, *(channel.label for channel in result_channels()))


def result_row(frame: LiveFrame) -> Array:
    """Give a frame's numbers in the order of `pipeline.live.outlet.result_channels`.

    Parameters
    ----------
    frame
        The frame; its generalised forces are those with the plates compensated, where they are.

    Returns
    -------
    Array
        (106,); a variant that is not computed is NaN.
    """
    best = list(frame.tau)[-1]
    return np.concatenate(
        [
            frame.q,
            frame.tau[best],
            frame.residual["measured"],
            frame.residual.get("compensated", UNKNOWN),
            [float(frame.quality), frame.computing_s],
        ]
    )
