"""What the thesis does not state of its laboratory, estimated from half of its Table III.

The 18 cells without compensation are fitted: how fast the machine swayed, how flexible it was, what
the assemblies weighed, where on the belts people walked, how long a perturbation counted, and
whether the platform's pose turned the forces into the lab. The 18 cells with compensation are not
used, so that they can judge.
"""

from dataclasses import dataclass
from itertools import product
from typing import Final, Literal

import numpy as np
import pandas as pd
from scipy.optimize import OptimizeResult, least_squares
from scipy.stats import t as student

from hbm.spatial import Array
from pipeline.trial.residuals import AXES
from pipeline.virtual_lab.analysis.printed_table_3 import THESIS_SUBJECTS
from pipeline.virtual_lab.analysis.processed_study import CELLS, KEYS, LENGTHS_S
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
FITTED: Final = ~CELLS.get_level_values("compensated").to_numpy(bool)
"""The cells without compensation, (36,)."""
AXIS: Final = np.array([AXES.index(axis) for axis in CELLS.get_level_values("axis")])
"""Which residual each cell is of, (36,)."""
CONFIDENCE: Final = 0.95


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


@dataclass(frozen=True, slots=True)
class Estimate:
    """The unstated values that fit the cells without compensation best.

    Attributes
    ----------
    value
        The estimates.
    low, high
        Ends of their 95 % intervals; the pose is that of the value.
    at_edge
        Names of values at the edge of what was simulated: their intervals end there.
    misfit
        Sum of the squared misfits of the 18 fitted cells in standard errors, by pose.
    freedom
        Fitted cells less estimated numbers.
    predicted
        By pose, all 36 cells at the estimates, interpolated [N, N·m].
    error
        Their standard error from the estimates, (36,) [N, N·m].
    added
        Residual of each axis that every cell was taken to have besides, (6,) [N, N·m]; zero where
        it was not estimated.
    """

    value: Unstated
    low: Unstated
    high: Unstated
    at_edge: tuple[str, ...]
    misfit: dict[Pose, float]
    freedom: int
    predicted: dict[Pose, Array]
    error: Array
    added: Array


def estimate(
    responses: dict[Pose, Response], printed: pd.DataFrame, *, adding: bool = False
) -> Estimate:
    """Estimate the unstated values from the cells without compensation.

    Parameters
    ----------
    responses
        By pose.
    printed
        Table III: ``condition, compensated, axis, mean, sd``.
    adding
        Whether to estimate as well a residual per axis that is independent of what is simulated and
        the same in every condition: a cell is then the root of the sum of both squares. Six more
        numbers for 18 cells leave little to test.

    Returns
    -------
    Estimate
        With the pose that fits better.

    Notes
    -----
    Weighted least squares; the error of a cell is that of the thesis' mean, of the simulated mean
    and of the polynomial, independent from cell to cell. Intervals are those of the linearised fit,
    widened by the root of the misfit per degree of freedom where that is above one (Birge 1932).
    """
    table = printed.set_index(KEYS).loc[CELLS]
    fits = {pose: _fit(response, table, adding) for pose, response in responses.items()}
    misfit = {pose: float(2 * fit.cost) for pose, fit in fits.items()}
    pose: Pose = min(fits, key=misfit.__getitem__)
    x, jacobian = fits[pose].x, fits[pose].jac
    freedom = int(FITTED.sum()) - len(x)
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * max(1.0, misfit[pose] / freedom)
    half = student.ppf((1 + CONFIDENCE) / 2, freedom) * np.sqrt(np.diag(covariance))
    low, high = _bounds(adding)
    at_edge = (np.isclose(x, low, atol=1e-3) | np.isclose(x, high, atol=1e-3))[: len(ESTIMATED)]
    slope = _slope(responses[pose], x)
    return Estimate(
        unstated_at(x, pose),
        unstated_at(np.maximum(x - half, low), pose),
        unstated_at(np.minimum(x + half, high), pose),
        tuple(name for name, at in zip(ESTIMATED, at_edge, strict=True) if at),
        misfit,
        freedom,
        {name: _cells(response, x) for name, response in responses.items()},
        np.sqrt(np.einsum("ci,ij,cj->c", slope, covariance, slope)),
        np.sqrt(x[len(ESTIMATED) :]) if adding else np.zeros(len(AXES)),
    )


def _terms(z: Array) -> Array:
    """Give the polynomial's terms at points in units of `REACH`, (points, 11)."""
    pairs = [z[:, i] * z[:, j] for i in range(3) for j in range(i, 3)]
    return np.column_stack([np.ones(len(z)), z, *pairs])


def _cells(response: Response, x: Array) -> Array:
    """Give the cells at the estimated numbers, to which squares of added residuals may belong."""
    cells, squares = response.at(x), x[len(ESTIMATED) :]
    return np.sqrt(cells**2 + squares[AXIS]) if len(squares) else cells


def _bounds(adding: bool) -> tuple[Array, Array]:
    ends = np.log(LENGTHS_S[0]), np.log(LENGTHS_S[-1])
    squares = ([0.0] * len(AXES), [np.inf] * len(AXES)) if adding else ([], [])
    low, high = (
        np.array([*[side] * 4, end, *square])
        for side, end, square in zip((-1.0, 1.0), ends, squares, strict=True)
    )
    return low, high


def _fit(response: Response, table: pd.DataFrame, adding: bool) -> OptimizeResult:
    """Fit from several starts: windows are not smooth."""
    wanted, sd = table["mean"].to_numpy(), table["sd"].to_numpy()

    def misfit(x: Array) -> Array:
        cells = _cells(response, x)
        error = np.hypot(sd / np.sqrt(THESIS_SUBJECTS), response.error * response.at(x))
        return np.asarray(((cells - wanted) / error)[FITTED])

    squares = [1.0] * len(AXES) if adding else []
    starts = [
        np.array([0.0, flexibility, 0.0, 0.0, np.log(length_s), *squares])
        for flexibility in (-0.5, 0.5)
        for length_s in (0.2, 0.35, 0.6)
    ]
    bounds = _bounds(adding)
    found = [least_squares(misfit, x, bounds=bounds, x_scale="jac") for x in starts]
    return min(found, key=lambda fit: float(fit.cost))


def _slope(response: Response, x: Array) -> Array:
    """Give the cells' derivatives by the estimated numbers, (36, 5 or 11)."""
    step = 1e-4 * np.maximum(1.0, np.abs(x))
    ends = [(_cells(response, x + d), _cells(response, x - d)) for d in np.diag(step)]
    return np.stack([(up - down) / (2 * s) for (up, down), s in zip(ends, step, strict=True)], 1)
