"""What the thesis does not state of its laboratory, estimated from half of its Table III.

The cells without compensation show the machine: how steeply it swayed, what the assemblies weighed,
where on the belts people walked, how long a perturbation counted, and whether the platform's pose
turned the forces into the lab. The cells with compensation are not used, so that they can judge.
"""

import os
import shutil
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final, Literal

import numpy as np
import pandas as pd
from scipy.optimize import OptimizeResult, least_squares

from hbm.spatial import Array
from pipeline.io.write import write_text
from pipeline.trial.residuals import AXES
from pipeline.virtual_lab.analysis.reproduction import (
    LENGTHS_S,
    PERTURBED,
    Step,
    after_onsets,
    cell_means,
    process,
    process_study,
    study_residuals,
)
from pipeline.virtual_lab.protocol.study_text import study_texts
from pipeline.virtual_lab.protocol.walking_protocol import ANALYSED_CONDITIONS, Setting

Pose = Literal["channels", "none"]
POSES: Final[tuple[Pose, ...]] = ("channels", "none")
"""Whether the platform's pose turned the forces into the lab, in both variants of the residuals."""
CENTER: Final = np.array([np.log(7.0), np.log(150.0), 0.0])
REACH: Final = np.array([np.log(1.75), np.log(1.1), 0.2])
"""Middle of the simulated studies and how far they reach: logarithms of the sway actuator's
bandwidth [Hz] and of an assembly's mass [kg] (the thesis: 150), and how far ahead of the middle of
the belts people walk [m]."""
DESIGN: Final = np.array(
    [(0.0, 0.0, 0.0)]
    + [tuple(s * row) for row in np.eye(3) for s in (-1.0, 1.0)]
    + list(product((-1.0, 1.0), repeat=3))
)
"""A face-centred design for a quadratic in three variables, in units of `REACH`."""
THESIS_SUBJECTS: Final = 9
QUANTILE_95: Final = 1.96
KEYS: Final = ["condition", "compensated", "axis"]


@dataclass(frozen=True, slots=True)
class Unstated:
    """What the thesis does not state.

    Attributes
    ----------
    sway_hz
        Bandwidth of the sway actuator [Hz].
    assembly_kg
        Mass of each belt assembly [kg].
    place_forward_m
        How far ahead of the middle of the belts people walked [m].
    window_s
        How long after the onset of a sway perturbation residuals count [s].
    pose
        Whether forces were turned into the lab by the platform's pose, in both variants.
    """

    sway_hz: float
    assembly_kg: float
    place_forward_m: float
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
            update={"sway_hz": self.sway_hz, "assembly_kg": self.assembly_kg}
        )
        faults = setting.faults.model_copy(update={"machine": machine})
        return setting.model_copy(update={"protocol": protocol, "faults": faults})


@dataclass(frozen=True, slots=True)
class Response:
    """How the cells of Table III depend on the unstated values, for one of `POSES`.

    Attributes
    ----------
    coefficients
        Of a quadratic of the cells' logarithms in units of `REACH`: (windows, 10, 36), windows in
        the order of `LENGTHS_S`.
    error
        Standard deviation of the studies about it, (36,), as a share of a cell.
    cells
        Keys of the 36 cells, in order.
    """

    coefficients: Array
    error: Array
    cells: pd.MultiIndex

    def at(self, z: Array, log_window: float) -> Array:
        """Give the cells, (36,) [N, N·m], at a point in units of `REACH`."""
        lengths = np.log(LENGTHS_S)
        right = int(np.clip(np.searchsorted(lengths, log_window), 1, len(lengths) - 1))
        share = (log_window - lengths[right - 1]) / (lengths[right] - lengths[right - 1])
        near = (1 - share) * self.coefficients[right - 1] + share * self.coefficients[right]
        return np.asarray(np.exp(_quadratic(z[None])[0] @ near), float)


@dataclass(frozen=True, slots=True)
class Estimate:
    """The unstated values that fit the cells without compensation best.

    Attributes
    ----------
    value
        The estimates.
    low, high
        Ends of their 95 % intervals, as `Unstated`; the pose is that of the value.
    at_edge
        Names of values at the edge of what was simulated: there an interval is one-sided.
    misfit
        Sum of the squared misfits of the 18 cells in standard errors, by pose.
    freedom
        Cells less estimated values.
    cells
        ``condition, compensated, axis``; ``thesis, thesis_sd`` as printed; ``estimated`` with what
        every laboratory adds (`floor`), ``error`` its standard error; ``used``, ``within`` the
        thesis' mean ± SD, and ``explained``, whether the means differ by less than 1.96 standard
        errors of both.
    floor
        Axis -> what the simulated residuals lack in every condition [N, N·m], estimated as well:
        root of the difference of squares.
    """

    value: Unstated
    low: Unstated
    high: Unstated
    at_edge: tuple[str, ...]
    misfit: dict[Pose, float]
    freedom: int
    cells: pd.DataFrame
    floor: dict[str, float]


def respond(setting: Setting, jobs: int, step: Step) -> dict[Pose, Response]:
    """Simulate a study for every point of `DESIGN`; process each with and without the pose."""
    logs: dict[Pose, list[Array]] = {pose: [] for pose in POSES}
    index = pd.MultiIndex.from_product([ANALYSED_CONDITIONS, (False, True), AXES], names=KEYS)
    for z in DESIGN:
        own = unstated_at(z, LENGTHS_S[0], "channels").apply(setting)
        with TemporaryDirectory(prefix="hbm_") as folder:
            first = Path(folder) / "channels"
            results = {"channels": process(own, first, jobs, step)}
            second = _without_pose(first / "study", Path(folder) / "none", own)
            results["none"] = process_study(second, second.parent / "results", jobs, step)
            for pose in POSES:
                logs[pose].append(np.log(_cells(results[pose], index)))
    return {pose: fit_response(np.stack(own), index) for pose, own in logs.items()}


def fit_response(logs: Array, cells: pd.MultiIndex) -> Response:
    """Fit a quadratic to the logarithms of cells, (points of `DESIGN`, windows, 36)."""
    terms = _quadratic(DESIGN)
    points, windows, count = logs.shape
    found, *_ = np.linalg.lstsq(terms, logs.reshape(points, -1), rcond=None)
    misfit = (logs.reshape(points, -1) - terms @ found).reshape(logs.shape)
    freedom = points - terms.shape[1]
    error = np.sqrt((misfit**2).sum(axis=0) / freedom).max(axis=0)
    by_window = np.asarray(found, float).reshape(-1, windows, count).swapaxes(0, 1)
    return Response(by_window, np.asarray(error, float), cells)


def estimate(responses: dict[Pose, Response], printed: pd.DataFrame) -> Estimate:
    """Estimate the unstated values from the cells without compensation, and judge the others.

    Parameters
    ----------
    responses
        By pose.
    printed
        Table III: ``condition, compensated, axis, mean, sd``.

    Returns
    -------
    Estimate
        With the pose that fits better.

    Notes
    -----
    Weighted least squares. A residual of the thesis is taken as that of the simulation and, in
    every condition alike, one of its own that is independent: ``f² = simulated² + floor²`` with a
    floor per axis, six more unknowns. Intervals are those of the linearised fit, widened by the
    root of the misfit per degree of freedom where that is above one (Birge 1932).
    """
    table = printed.set_index(KEYS)
    fits = {pose: _fit(response, table) for pose, response in responses.items()}
    misfit = {pose: float(2 * fit.cost) for pose, fit in fits.items()}
    pose: Pose = min(POSES, key=misfit.__getitem__)
    fit, response = fits[pose], responses[pose]
    used = ~response.cells.get_level_values("compensated").to_numpy(bool)
    freedom = int(used.sum()) - len(fit.x)
    covariance = np.linalg.pinv(fit.jac.T @ fit.jac) * max(1.0, misfit[pose] / freedom)
    half = QUANTILE_95 * np.sqrt(np.maximum(np.diag(covariance), 0.0))
    low, high = _bounds()
    ends = [np.clip(fit.x + s * half, low, high) for s in (-1.0, 1.0)]
    names = ("sway_hz", "assembly_kg", "place_forward_m", "window_s")
    edge = np.isclose(fit.x[:4], low[:4]) | np.isclose(fit.x[:4], high[:4])
    return Estimate(
        _named(fit.x, pose),
        _named(ends[0], pose),
        _named(ends[1], pose),
        tuple(name for name, at in zip(names, edge, strict=True) if at),
        misfit,
        freedom,
        _judged(response, table, fit.x, covariance, used),
        dict(zip(AXES, np.sqrt(fit.x[4:]).tolist(), strict=True)),
    )


def unstated_at(z: Array, window_s: float, pose: Pose) -> Unstated:
    """Give the unstated values at a point in units of `REACH`.

    Examples
    --------
    >>> unstated_at(np.zeros(3), 0.3, "none").assembly_kg
    150.0
    """
    hz, kg, ahead = CENTER + REACH * z
    return Unstated(
        round(float(np.exp(hz)), 6), round(float(np.exp(kg)), 6), float(ahead), window_s, pose
    )


def _named(x: Array, pose: Pose) -> Unstated:
    return unstated_at(x[:3], float(np.exp(x[3])), pose)


def _quadratic(z: Array) -> Array:
    """Give constant, linear and quadratic terms of three variables, (P, 10)."""
    pairs = [z[:, i] * z[:, j] for i in range(3) for j in range(i, 3)]
    return np.column_stack([np.ones(len(z)), z, *pairs])


def _bounds() -> tuple[Array, Array]:
    lengths = np.log(LENGTHS_S)
    low = np.concatenate([-np.ones(3), lengths[:1], np.zeros(6)])
    return low, np.concatenate([np.ones(3), lengths[-1:], np.full(6, np.inf)])


def _floors(response: Response) -> Array:
    """Give the number of each cell's axis, (36,)."""
    return np.array([AXES.index(a) for a in response.cells.get_level_values("axis")])


def _with_floor(response: Response, x: Array) -> Array:
    simulated = response.at(x[:3], float(x[3]))
    return np.asarray(np.sqrt(simulated**2 + x[4:][_floors(response)]))


def _errors(response: Response, table: pd.DataFrame, x: Array) -> Array:
    """Give the standard error of the difference of each cell, (36,) [N, N·m]."""
    of_thesis = table.loc[response.cells, "sd"].to_numpy() / np.sqrt(THESIS_SUBJECTS)
    of_studies = response.error * response.at(x[:3], float(x[3]))
    return np.asarray(np.hypot(of_thesis, of_studies), float)


def _fit(response: Response, table: pd.DataFrame) -> OptimizeResult:
    """Fit from a start at every window, as windows are not smooth."""
    used = ~response.cells.get_level_values("compensated").to_numpy(bool)
    wanted = table.loc[response.cells, "mean"].to_numpy()
    low, high = _bounds()

    def misfit(x: Array) -> Array:
        error = _errors(response, table, x)
        return np.asarray(((_with_floor(response, x) - wanted) / error)[used])

    starts = [
        np.concatenate([np.zeros(3), [np.log(length_s)], np.ones(6)])
        for length_s in LENGTHS_S[1:-1]
    ]
    found = [least_squares(misfit, x, bounds=(low, high), x_scale="jac") for x in starts]
    return min(found, key=lambda fit: float(fit.cost))


def _judged(
    response: Response, table: pd.DataFrame, x: Array, covariance: Array, used: Array
) -> pd.DataFrame:
    own = _with_floor(response, x)
    step = 1e-4
    slope = np.stack(
        [
            (_with_floor(response, x + step * d) - _with_floor(response, x - step * d)) / 2 / step
            for d in np.eye(len(x))
        ],
        axis=1,
    )
    error = np.sqrt(np.einsum("ci,ij,cj->c", slope, covariance, slope))
    printed = table.loc[response.cells]
    off = np.abs(own - printed["mean"].to_numpy())
    both = np.hypot(error, _errors(response, table, x))
    return pd.DataFrame(
        {
            **{key: response.cells.get_level_values(key) for key in KEYS},
            "thesis": printed["mean"].to_numpy(),
            "thesis_sd": printed["sd"].to_numpy(),
            "estimated": own,
            "error": error,
            "used": used,
            "within": off <= printed["sd"].to_numpy(),
            "explained": off <= QUANTILE_95 * both,
        }
    )


def _cells(paths: list[Path], index: pd.MultiIndex) -> Array:
    """Give the cells of a study, (windows, 36): sway over windows, the others the same in all."""
    still = cell_means(study_residuals(paths)).set_index(KEYS)["rms"]
    after = after_onsets(paths).groupby(["length_s", "compensated", "axis"])["rms"].mean()
    rows = []
    for length_s in LENGTHS_S:
        cells = still.copy()
        for compensated, axis in product((False, True), AXES):
            cells[(PERTURBED, compensated, axis)] = after.loc[(length_s, compensated, axis)]
        rows.append(cells.loc[index].to_numpy())
    return np.stack(rows)


def _without_pose(study: Path, folder: Path, setting: Setting) -> Path:
    """Give the same study, hard-linked, with a study file that states no pose."""
    other = folder / "study"
    shutil.copytree(study, other, copy_function=os.link)
    protocol = setting.protocol.model_copy(update={"pose": "none"})
    for name, text in study_texts(setting.model_copy(update={"protocol": protocol})).items():
        (other / name).unlink()
        write_text(text, other / name)
    return other
