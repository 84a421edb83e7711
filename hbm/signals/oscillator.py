"""A mass on springs and dampers whose support is accelerated."""

import numpy as np
from scipy.signal import cont2discrete, lfilter

from hbm.signals.samples import mean_rate_hz
from hbm.spatial import Array


def oscillation(
    drive: Array, time: Array, frequency_hz: float, damping: float
) -> tuple[Array, Array]:
    """Give how a mass moves relative to its accelerated support.

    Parameters
    ----------
    drive
        Acceleration of the support times -1, (T, K) [m/s²]; the same in other units gives the same
        in others.
    time
        In equal steps, (T,) [s].
    frequency_hz, damping
        Natural frequency and damping ratio.

    Returns
    -------
    displacement, acceleration
        ``d`` and ``d̈`` of ``d̈ + 2 ζ ω ḋ + ω² d = drive``, from rest, (T, K) [m, m/s²]; solved
        exactly for a drive that is linear between samples.

    Examples
    --------
    >>> displacement, acceleration = oscillation(np.ones((500, 1)), np.arange(500) / 100, 2.0, 0.5)
    >>> f"{displacement[-1, 0] * (2 * np.pi * 2.0) ** 2:.3f} {acceleration[-1, 0]:.3f}"
    '1.000 -0.000'
    """
    omega = 2 * np.pi * frequency_hz
    loss = 2 * damping * omega
    system, step = np.array([1.0, loss, omega**2]), 1 / mean_rate_hz(time)
    filters = [
        cont2discrete((np.array(numerator), system), step, method="foh")[:2]
        for numerator in ([1.0], [1.0, 0.0])
    ]
    shift, speed = (lfilter(np.ravel(up), down, drive, axis=0) for up, down in filters)
    return shift, drive - loss * speed - omega**2 * shift
