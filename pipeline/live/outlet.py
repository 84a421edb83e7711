"""Streams that this program sends by Lab Streaming Layer, and frames as rows of numbers."""

import socket
from collections.abc import Sequence
from importlib import import_module
from ipaddress import IPv4Address
from typing import Any, Final
from xml.etree.ElementTree import Element

import numpy as np

from hbm.coordinates import TREE
from hbm.spatial import WRENCH_COMPONENTS, Array
from pipeline.config.live import LOOPBACK, own_address
from pipeline.io.recording import Plate
from pipeline.io.streams import Channel
from pipeline.live.frames.chain import LiveFrame
from pipeline.live.recording import describe

MIN_PROBES: Final = 3
"""Answers of eight that make a measurement of a clock: with six, a busy computer has none."""
PROBE_INTERVAL_S: Final = 0.02
"""Between the eight: a first measurement then takes 0.3 s; with 0.064 s, the usual one, 0.65 s."""
EXTRA: Final = "pip install 'hbm-residuals[live]'"

_listening: list[str] = []
"""Where this process listens, once it has begun to; the library reads its settings only once."""


def load_lsl(listen: str = LOOPBACK) -> Any:
    """Import Lab Streaming Layer, with its discovery bound to one address.

    Parameters
    ----------
    listen
        Address of this computer in the laboratory's network, or of the loopback, by default:
        then neither queries nor answers leave this computer.

    Returns
    -------
    module
        ``pylsl``.

    Raises
    ------
    ValueError
        It is not installed, the address is none, or this process listens on another one.

    Notes
    -----
    Settings in a file ``lsl_api.cfg`` are not used. Samples and clocks have ports of their own
    (16572 and following), which the library opens on all interfaces; docs/live.md says how to
    close them to others.
    """
    try:
        address = IPv4Address(own_address(listen))
    except ValueError as error:
        raise ValueError(f"listen: {error}") from error
    lsl = import_extra("pylsl", "Lab Streaming Layer")
    if not _listening:
        _require_own(address)
        scope = "ResolveScope = machine\n" if address.is_loopback else ""
        interfaces = "" if address.is_loopback else f"Interfaces = {{{address}}}\n"
        lsl.set_config_content(
            "[ports]\nIPv6 = disable\n"
            f"[multicast]\n{scope}{interfaces}ListenAddress = {address}\n"
            f"[tuning]\nTimeUpdateMinProbes = {MIN_PROBES}\n"
            f"TimeProbeInterval = {PROBE_INTERVAL_S}\n[log]\nlevel = -3\n"
        )
        _listening.append(str(address))
    if _listening != [str(address)]:
        raise ValueError(
            f"listen: this process listens on {_listening[0]} already, not on {address}; Lab "
            "Streaming Layer can be bound once"
        )
    return lsl


def _require_own(address: IPv4Address) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_port:
        try:
            any_port.bind((str(address), 0))
        except OSError as error:
            raise ValueError(
                f"listen: {address} is not an address of this computer ({error.strerror}); its "
                "network settings list those that it has"
            ) from error


def import_extra(module: str, what: str) -> Any:
    """Import a module of the extra ``live``; a ValueError names the extra where it is missing."""
    try:
        return import_module(module)
    except ImportError as missing:
        raise ValueError(f"{what} needs the extra live: {EXTRA}") from missing
    except (OSError, RuntimeError) as broken:  # pylsl without its library, where it has no wheel
        reason = str(broken).splitlines()[0] if str(broken) else type(broken).__name__
        raise ValueError(f"{what} does not load: {reason}") from broken


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
        What else its description states, as for `pipeline.live.recording.describe`.
    listen
        As for `pipeline.live.outlet.load_lsl`, with its errors.

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
    """Open the stream of results, whose samples `pipeline.live.outlet.result_row` gives.

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
        As for `pipeline.live.outlet.load_lsl`, with its errors.
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
