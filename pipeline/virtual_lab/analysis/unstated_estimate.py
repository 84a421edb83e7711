"""What the thesis does not state of its laboratory, estimated from half of its Table III.

The 18 cells without compensation are fitted: how fast the machine swayed, how flexible it was, what
the assemblies weighed, where on the belts people walked, how long a perturbation counted, and
whether the platform's pose turned the forces into the lab. The 18 cells with compensation are not
used, so that they can judge.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
import pandas as pd
from scipy.optimize import OptimizeResult, least_squares
from scipy.stats import t as student

from hbm.spatial import Array
from pipeline.trial.residuals import AXES
from pipeline.virtual_lab.analysis.printed_table_3 import THESIS_SUBJECTS
from pipeline.virtual_lab.analysis.processed_study import CELLS, KEYS, LENGTHS_S
from pipeline.virtual_lab.analysis.unstated import (
    ESTIMATED,
    Pose,
    Response,
    Unstated,
    unstated_at,
)

FITTED: Final = ~CELLS.get_level_values("compensated").to_numpy(bool)
"""The cells without compensation, (36,)."""
AXIS: Final = np.array([AXES.index(axis) for axis in CELLS.get_level_values("axis")])
"""Which residual each cell is of, (36,)."""
CONFIDENCE: Final = 0.95
UNIFORM: Final = 12.0
"""Square of a uniform distribution's width over its variance."""


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
        Their standard error from the estimates, (36,) [N, N·m]: of the linearised fit, and the
        largest difference to the fits at other windows that are as good.
    interpolation
        Their standard error from the interpolation and the simulated subjects, (36,) [N, N·m].
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
    interpolation: Array
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
    What the cells hardly tell is known to be within what was simulated: as precisely as a uniform
    distribution over that range. As actuators and window act alike, the numbers are also fitted at
    each of `LENGTHS_S`; intervals hold those of every such fit that is as good as the error allows.
    The error of simulated means is a share of their value, so a cell that is simulated too large
    counts less than one that is too small by as much.
    """
    table = printed.set_index(KEYS).loc[CELLS]
    fits = {pose: _fits(response, table, adding) for pose, response in responses.items()}
    misfit = {pose: float(2 * best.cost) for pose, (best, *_) in fits.items()}
    pose: Pose = min(fits, key=misfit.__getitem__)
    x = fits[pose][0].x
    freedom = int(FITTED.sum()) - len(x)
    widening = max(1.0, misfit[pose] / freedom)
    quantile = student.ppf((1 + CONFIDENCE) / 2, freedom)
    low, high = _bounds(adding)
    prior = np.diag(UNIFORM / (high - low) ** 2)
    as_good = [fit for fit in fits[pose] if 2 * fit.cost - misfit[pose] <= quantile**2 * widening]
    covariances = [np.linalg.pinv(fit.jac.T @ fit.jac / widening + prior) for fit in as_good]
    half = [quantile * np.sqrt(np.diag(covariance)) for covariance in covariances]
    ends = [
        np.clip([fit.x + side * own for fit, own in zip(as_good, half, strict=True)], low, high)
        for side in (-1.0, 1.0)
    ]
    at_edge = (np.isclose(x, low, atol=1e-3) | np.isclose(x, high, atol=1e-3))[: len(ESTIMATED)]
    slope, cells = _slope(responses[pose], x), _cells(responses[pose], x)
    apart = np.abs([_cells(responses[pose], fit.x) - cells for fit in as_good]).max(axis=0)
    simulated = responses[pose].at(x)
    return Estimate(
        unstated_at(x, pose),
        unstated_at(ends[0].min(axis=0), pose),
        unstated_at(ends[1].max(axis=0), pose),
        tuple(name for name, at in zip(ESTIMATED, at_edge, strict=True) if at),
        misfit,
        freedom,
        {name: _cells(response, x) for name, response in responses.items()},
        np.sqrt(np.einsum("ci,ij,cj->c", slope, covariances[0], slope) + apart**2),
        responses[pose].error * simulated**2 / cells,
        np.sqrt(x[len(ESTIMATED) :]) if adding else np.zeros(len(AXES)),
    )


def simulated_range() -> tuple[Unstated, Unstated]:
    """Give the ends of what was simulated, where intervals end as well.

    Examples
    --------
    >>> low, high = simulated_range()
    >>> (low.flexibility, high.flexibility), (low.window_s, high.window_s)
    ((1.0, 16.0), (0.1, 0.9))
    """
    low, high = (unstated_at(end, "channels") for end in _bounds(adding=False))
    return low, high


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


def _fits(response: Response, table: pd.DataFrame, adding: bool) -> list[OptimizeResult]:
    """Fit the numbers: the best fit, and the best ones at each of `LENGTHS_S`."""
    wanted, sd = table["mean"].to_numpy(), table["sd"].to_numpy()

    def misfit(x: Array) -> Array:
        cells = _cells(response, x)
        error = np.hypot(sd / np.sqrt(THESIS_SUBJECTS), response.error * response.at(x))
        return np.asarray(((cells - wanted) / error)[FITTED])

    squares = [1.0] * len(AXES) if adding else []
    low, high = _bounds(adding)
    window, narrow = np.arange(len(low)) == ESTIMATED.index("window_s"), 1e-6
    found = []
    for length in np.log(LENGTHS_S):
        bounds = (
            np.where(window, length - narrow, low),
            np.where(window, length + narrow, high),
        )
        fits = [
            least_squares(misfit, [0.0, flexibility, 0.0, 0.0, length, *squares], bounds=bounds)
            for flexibility in (-0.5, 0.5)
        ]
        found.append(min(fits, key=_cost))
    nearest = sorted(found, key=_cost)[:2]
    best = [
        least_squares(misfit, np.clip(fit.x, low, high), bounds=(low, high), x_scale="jac")
        for fit in nearest
    ]
    return [min(best, key=_cost), *found]


def _cost(fit: OptimizeResult) -> float:
    return float(fit.cost)


def _slope(response: Response, x: Array) -> Array:
    """Give the cells' derivatives by the estimated numbers, (36, 5 or 11)."""
    step = 1e-4 * np.maximum(1.0, np.abs(x))
    ends = [(_cells(response, x + d), _cells(response, x - d)) for d in np.diag(step)]
    return np.stack([(up - down) / (2 * s) for (up, down), s in zip(ends, step, strict=True)], 1)
