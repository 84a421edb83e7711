"""What a sender's channels carry, and how their samples become m, N, N·m and lab axes."""

from collections.abc import Callable, Sequence

import numpy as np

from hbm.spatial import Array
from pipeline.io.axes import parse_axes
from pipeline.io.stated import Stated
from pipeline.io.xdf.channels import Channel, marker_layout, si_units
from pipeline.live.stream import StreamDescription

Convert = Callable[[Array], Array]
"""From samples as sent, (N, K), to samples of a `Samples`."""


def describe_markers(
    name: str, channels: Sequence[Channel], rate_hz: float, stated: Stated, axes: str = ""
) -> tuple[StreamDescription, Convert]:
    """Describe a stream of markers.

    Parameters
    ----------
    name, channels, rate_hz
        As the sender states them.
    stated
        What a person states: axes, unit, labels to rename, the prefix of the subject.
    axes
        The sender's axes; empty where it does not state them.

    Returns
    -------
    description, convert
        Positions in lab axes [m]; NaN where a marker is not seen.

    Raises
    ------
    ValueError
        The axes are not known, or as `pipeline.io.xdf.channels.marker_layout`.
    """
    layout = marker_layout(channels, stated)
    known = stated.axes or axes
    if not known:
        raise ValueError(
            "the axes of its markers are not known; state them, for example --axes "
            'forward,left,up, or axes = "forward,left,up" in study.toml'
        )
    to_lab = parse_axes(known)

    def convert(values: Array) -> Array:
        found = layout.positions(values).reshape(-1, 3) @ to_lab.T
        return np.asarray(found).reshape(len(values), -1)

    units = ("m",) * len(layout.names)
    return StreamDescription(name, "markers", layout.names, units, rate_hz), convert


def describe_signals(
    name: str, channels: Sequence[Channel], rate_hz: float
) -> tuple[StreamDescription, Convert]:
    """Describe a stream of other signals; forces become N, moments N·m."""
    units, factors = si_units(channels)
    labels = tuple(channel.label for channel in channels)
    return (
        StreamDescription(name, "analog", labels, units, rate_hz),
        lambda values: np.asarray(values * factors, float),
    )
