"""Lab Streaming Layer: where its discovery listens."""

import socket
from importlib import import_module
from ipaddress import IPv4Address
from typing import Any, Final

from pipeline.config.live import LOOPBACK, own_address

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
