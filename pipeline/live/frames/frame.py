"""What is known of one frame as soon as it is measured."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from hbm.spatial import Array, Mask
from pipeline.trial.quality import Quality


def _none() -> Array:
    return np.empty((0, 3))


@dataclass(frozen=True, slots=True)
class LiveFrame:
    """One frame.

    Attributes
    ----------
    number
        Of the frame among those received, from 0.
    time
        On the streams' clock [s].
    q
        Filtered coordinates, (46,) [m and rad].
    tau
        "measured" and, with a calibration, "compensated" -> generalized forces, (46,) [N, N·m].
    residual
        The same -> residual on the pelvis in the reported axes (x forward, y right, z up) about
        mid-hip, (6,) [N, N·m].
    by_foot
        The same -> wrench under the left and the right foot, filtered, lab axes about the lab
        origin, (2, 6) [N, N·m].
    contact
        Whether a plate carries the left and the right foot, (2,).
    marker_error
        Distance of each marker from the model, (K,) [m]; NaN where it was not used.
    markers
        As received, in the order of the stream, (M, 3) [m].
    platform
        Rotation, (3, 3), and position, (3,) [m], of the platform, NaN where unknown; None where it
        stands still.
    quality
        Why it does not count.
    computing_s
        From the arrival of its last sample until it was known [s].
    """

    number: int
    time: float
    q: Array
    tau: Mapping[str, Array]
    residual: Mapping[str, Array]
    by_foot: Mapping[str, Array]
    contact: Mask
    marker_error: Array
    quality: Quality
    computing_s: float
    markers: Array = field(default_factory=_none)
    platform: tuple[Array, Array] | None = None

    @property
    def rms_marker_error_m(self) -> float:
        """Root mean square of the marker errors; NaN where there are none [m]."""
        seen = self.marker_error[np.isfinite(self.marker_error)]
        return float(np.sqrt(np.mean(seen**2))) if len(seen) else float("nan")
