"""What the thesis does not state of its laboratory, and how its Table III depends on that."""

from dataclasses import dataclass
from itertools import product
from typing import Final, Literal

import numpy as np

from hbm.spatial import Array
from pipeline.virtual_lab.analysis.processed_study import LENGTHS_S
from pipeline.virtual_lab.protocol.walking_protocol import Setting

Pose = Literal["channels", "none"]
POSES: Final[tuple[Pose, ...]] = ("channels", "none")
"""Whether the platform's pose turned the forces into the lab, in both variants of the residuals."""
CENTER: Final = np.array([np.log(7.0), np.log(4.0), 0.0, np.log(150.0)])
REACH: Final = np.array([np.log(1.75), np.log(4.0), 0.2, np.log(1.1)])
"""Middle of the simulated studies and how far they reach: logarithms of the sway actuator's
bandwidth [Hz] and of the flexibility, how far ahead of the middle of the belts people walk [m], and
logarithm of an assembly's mass [kg] (150 stated; 136 follow from Table II of the thesis)."""
DESIGN: Final = np.array(
    [(0.0, 0.0, 0.0, 0.0)]
    + [(*(s * row), 0.0) for row in np.eye(3) for s in (-1.0, 1.0)]
    + [(*signs, float(np.prod(signs))) for signs in product((-1.0, 1.0), repeat=3)]
)
"""Face-centred, for a quadratic in the first three variables and a line in the mass, in units of
`REACH`."""
REFERENCE: Final = DESIGN.tolist().index([0.0, -1.0, 0.0, 0.0])
"""The point with the laboratory's defaults."""


@dataclass(frozen=True, slots=True)
class Unstated:
    """What the thesis does not state.

    Attributes
    ----------
    sway_hz
        Bandwidth of the sway actuator [Hz]: how steeply a perturbation starts.
    flexibility
        Of the structure, 1 being the laboratory's default.
    place_forward_m
        How far ahead of the middle of the belts people walked [m].
    assembly_kg
        Mass of each belt assembly [kg].
    window_s
        How long after the onset of a sway perturbation residuals count [s].
    pose
        Whether forces were turned into the lab by the platform's pose, in both variants.
    """

    sway_hz: float
    flexibility: float
    place_forward_m: float
    assembly_kg: float
    window_s: float
    pose: Pose

    def apply(self, setting: Setting) -> Setting:
        """Give a setting with these values."""
        protocol = setting.protocol.model_copy(
            update={
                "place_forward_m": self.place_forward_m,
                "sway_window": self.window_s,
                "pose": self.pose,
            }
        )
        machine = setting.faults.machine.model_copy(
            update={
                "sway_hz": self.sway_hz,
                "flexibility": self.flexibility,
                "assembly_kg": self.assembly_kg,
            }
        )
        faults = setting.faults.model_copy(update={"machine": machine})
        return setting.model_copy(update={"protocol": protocol, "faults": faults})


ESTIMATED: Final = ("sway_hz", "flexibility", "place_forward_m", "assembly_kg", "window_s")
"""The values that are numbers, in the order of the fit."""


def unstated_at(x: Array, pose: Pose) -> Unstated:
    """Give values at a point: four in units of `REACH`, and the logarithm of the window [s].

    Examples
    --------
    >>> unstated_at(np.array([0.0, -1.0, 0.0, 0.0, np.log(0.3)]), "none")
    Unstated(sway_hz=7.0, flexibility=1.0, place_forward_m=0.0, assembly_kg=150.0, \
window_s=0.3, pose='none')
    """
    hz, flexibility, ahead, kg = CENTER + REACH * x[:4]
    return Unstated(
        round(float(np.exp(hz)), 2),
        round(float(np.exp(flexibility)), 2),
        round(float(ahead), 3),
        round(float(np.exp(kg)), 1),
        round(float(np.exp(x[4])), 3),
        pose,
    )


@dataclass(frozen=True, slots=True)
class Response:
    """How the cells of Table III depend on the unstated values, for one of `POSES`.

    Attributes
    ----------
    coefficients
        Of `_terms` for the cells' logarithms: (windows, 11, 36), windows as in `LENGTHS_S`.
    error
        Standard error, (36,), as a share of a cell: of the mean of the simulated subjects, and of
        the simulated studies about the polynomial.
    """

    coefficients: Array
    error: Array

    def at(self, x: Array) -> Array:
        """Give the cells, (36,) [N, N·m], at a point as `unstated_at` takes it."""
        lengths = np.log(LENGTHS_S)
        right = int(np.clip(np.searchsorted(lengths, x[4]), 1, len(lengths) - 1))
        share = (x[4] - lengths[right - 1]) / (lengths[right] - lengths[right - 1])
        near = (1 - share) * self.coefficients[right - 1] + share * self.coefficients[right]
        return np.asarray(np.exp(_terms(x[None, :4])[0] @ near), float)


def fit_response(logs: Array, shift: Array, spread: Array) -> Response:
    """Fit polynomials to the logarithms of simulated cells.

    Parameters
    ----------
    logs
        Of a few subjects' means at the points of `DESIGN`, (15, windows, 36).
    shift
        By how much the logarithms of all subjects' means exceed them where both were simulated,
        (windows, 36): a few subjects show differences between settings, all of them the level.
    spread
        Standard error of all subjects' means, (36,), as a share of a cell.

    Returns
    -------
    Response
        Of all subjects.
    """
    terms = _terms(DESIGN)
    flat = logs.reshape(len(DESIGN), -1)
    found, *_ = np.linalg.lstsq(terms, flat, rcond=None)
    freedom = len(DESIGN) - terms.shape[1]
    misfit = np.sqrt(((flat - terms @ found) ** 2).sum(axis=0) / freedom).reshape(shift.shape)
    coefficients = found.reshape(-1, *shift.shape).swapaxes(0, 1)
    coefficients[:, 0] += shift
    error = np.asarray(np.hypot(misfit.max(axis=0), spread), float)
    return Response(np.asarray(coefficients, float), error)


def _terms(z: Array) -> Array:
    """Give the polynomial's terms at points in units of `REACH`, (points, 11)."""
    pairs = [z[:, i] * z[:, j] for i in range(3) for j in range(i, 3)]
    return np.column_stack([np.ones(len(z)), z, *pairs])
