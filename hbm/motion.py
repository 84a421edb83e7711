"""Motion: the coordinates of a trial over time, and how closely they fit the markers."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.coordinates import COORDINATES, INDEX, N_Q
from hbm.spatial import Array, Mask, read_only

FLAGS: Final = ("converged", "observed")
"""Fields of `Motion` that are true or false."""


@dataclass(frozen=True, slots=True)
class Motion:
    """Coordinates over time.

    Attributes
    ----------
    time
        (T,) [s].
    q, v, a
        Coordinates and their derivatives in the order of `hbm.coordinates.COORDINATES`, (T, 46)
        [m and rad, per s, per s²]. ``v`` and ``a`` are NaN until the motion has been filtered. A
        frame that could not be solved is NaN.
    markers
        Names of the markers that it was solved from, (K,).
    marker_error
        Distance of each marker from the model, (T, K) [m]; NaN where the marker was missing.
    converged
        Whether the inverse kinematics converged, (T,).
    observed
        Whether the visible markers determined each coordinate, (T, 46); the others were held at
        zero or interpolated in time.
    gradient
        Largest entry of the cost's gradient at the last step, (T,) [m and m²/rad]; NaN where
        nothing was solved.

    Examples
    --------
    With ``static``, the markers of a calibration pose, and ``body``, built from them:

    >>> import hbm
    >>> motion = hbm.solve_ik(body, static)
    >>> motion.q.shape, motion.names[:3], bool(motion.converged.all())
    ((100, 46), ('PelvisX', 'PelvisY', 'PelvisZ'), True)
    >>> f"{motion.coordinate('PelvisZ')[0]:.3f} m"
    '0.926 m'
    """

    time: Array
    q: Array
    v: Array
    a: Array
    markers: tuple[str, ...]
    marker_error: Array
    converged: Mask
    observed: Mask
    gradient: Array | None = None

    def __post_init__(self) -> None:
        frames = len(self.time)
        if self.gradient is None:
            object.__setattr__(self, "gradient", np.full(frames, np.nan))
        columns = dict.fromkeys(("q", "v", "a", "observed"), (frames, N_Q))
        columns["marker_error"] = frames, len(self.markers)
        for name in ("time", "q", "v", "a", "marker_error", "gradient", *FLAGS):
            shape = columns.get(name, (frames,))
            given = getattr(self, name)
            value = read_only(given, bool) if name in FLAGS else read_only(given)
            if value.shape != shape:
                raise ValueError(f"motion: {name} must have shape {shape}, got {value.shape}")
            object.__setattr__(self, name, value)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns of ``q``, ``v`` and ``a``."""
        return COORDINATES

    def coordinate(self, name: str) -> Array:
        """Give one coordinate over time by its name, (T,) [m or rad]."""
        if name not in INDEX:
            raise KeyError(f"no coordinate {name!r}; there are: {', '.join(COORDINATES)}")
        return np.asarray(self.q[:, INDEX[name]])
