"""Streams that this program sends by Lab Streaming Layer."""

from collections.abc import Sequence
from typing import Any, Final
from xml.etree.ElementTree import Element

import numpy as np

from hbm.coordinates import TREE
from hbm.spatial import WRENCH_COMPONENTS, Array
from pipeline.config.live import LOOPBACK
from pipeline.io.recording import Plate
from pipeline.io.xdf.channels import Channel
from pipeline.live.description import describe
from pipeline.live.network import load_lsl

RESULTS: Final = "hbm"
"""Name of the stream of results; it names no person."""
BUFFER_S: Final = 10
"""Kept for a slow receiver; then its oldest samples are lost, and nobody waits."""


class Outlet:
    """Sends samples of one stream to whoever receives them, and never waits for them.

    Parameters
    ----------
    name
        The stream's name. It is also its identity, by which receivers find it again.
    content_type
        As XDF's meta-data name it, such as "MoCap".
    channels
        What each channel holds.
    rate_hz
        Nominal sampling rate [Hz].
    parts, plates
        What else its description states, as for `pipeline.live.description.describe`.
    listen
        As for `pipeline.live.network.load_lsl`, with its errors.

    Notes
    -----
    The library sends the name of this computer with every description. Nothing else identifies
    anyone.
    """

    def __init__(
        self,
        name: str,
        content_type: str,
        channels: Sequence[Channel],
        rate_hz: float,
        *,
        parts: Sequence[tuple[str, str]] = (),
        plates: Sequence[Plate] = (),
        listen: str = LOOPBACK,
    ) -> None:
        lsl = load_lsl(listen)
        info = lsl.StreamInfo(
            name, content_type, len(channels), rate_hz, "double64", f"hbm-residuals {name}"
        )
        _append(info.desc(), describe(channels, parts, plates))
        self._outlet: Any = lsl.StreamOutlet(info, 0, BUFFER_S)

    def push(self, time: Array, values: Array) -> None:
        """Send samples, (N, K), taken at times on this computer's clock, (N,) [s]."""
        if len(time):
            self._outlet.push_chunk(np.ascontiguousarray(values), np.asarray(time, float))

    def push_one(self, time_s: float, values: Array) -> None:
        """Send one sample, (K,)."""
        self._outlet.push_chunk(values, time_s)

    @property
    def has_receivers(self) -> bool:
        """Whether anyone receives."""
        return bool(self._outlet.have_consumers())

    def close(self) -> None:
        """Stop sending; what receivers have not taken yet is lost."""
        self._outlet = None


def result_outlet(
    rate_hz: float,
    *,
    filter_delay_s: float,
    resampling_delay_s: float,
    name: str = RESULTS,
    listen: str = LOOPBACK,
) -> Outlet:
    """Open the stream of results, whose samples `pipeline.live.result_row.result_row` gives.

    Parameters
    ----------
    rate_hz
        Of the cameras [Hz].
    filter_delay_s, resampling_delay_s
        By which the filter makes values late, and how long a frame waits for the samples that it
        needs, as `pipeline.live.frames.chain.LiveChain` has them [s]; the description states both.
    name
        The stream's name.
    listen
        As for `pipeline.live.network.load_lsl`, with its errors.
    """
    parts = [
        ("filter_delay_s", repr(float(filter_delay_s))),
        ("resampling_delay_s", repr(float(resampling_delay_s))),
    ]
    channels = result_channels()
    return Outlet(name, "Biomechanics", channels, rate_hz, parts=parts, listen=listen)


def result_channels() -> tuple[Channel, ...]:
    """Give the channels of the stream of results.

    Returns
    -------
    tuple of Channel
        46 coordinates (``q``) and their 46 generalised forces (``tau``), 6 pelvis residuals as
        measured and 6 compensated (x forward, y right, z up), quality, computing time: 106.

    Examples
    --------
    >>> channels = result_channels()
    >>> len(channels), channels[0].label, channels[92].label, channels[-1].unit
    (106, 'q.PelvisX', 'residual.measured.Fx', 's')
    """
    found = [Channel(f"q.{c.name}", "m" if c.translates else "rad", type="Angle") for c in TREE] + [
        Channel(f"tau.{c.name}", "N" if c.translates else "N·m", type="Moment") for c in TREE
    ]
    for variant in ("measured", "compensated"):
        found += [
            Channel(f"residual.{variant}.{name}", "N" if name[0] == "F" else "N·m", type="Residual")
            for name in WRENCH_COMPONENTS
        ]
    return (*found, Channel("quality", "", type="Quality"), Channel("computing_time", "s"))


def _append(desc: Any, described: Element) -> None:
    """Write the parts of a description into that of a stream of the library."""
    for part in described:
        if len(part):
            _append(desc.append_child(part.tag), part)
        else:
            desc.append_child_value(part.tag, part.text or "")
