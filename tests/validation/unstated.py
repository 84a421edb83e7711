"""What the thesis does not state of its laboratory, estimated from half of its Table III.

The 18 cells without compensation are fitted: how fast the machine swayed, how flexible it was, what
the assemblies weighed, where on the belts people walked, how long a perturbation counted, and
whether the platform's pose turned the forces into the lab. The 18 cells with compensation are not
used, so that they can judge.
"""

from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final, Literal

import numpy as np
import pandas as pd
from scipy.optimize import OptimizeResult, least_squares
from scipy.stats import t as student

from hbm.spatial import Array
from pipeline.io.write import write_text
from pipeline.run.load import collect
from pipeline.virtual_lab.protocol.walking_protocol import Setting
from pipeline.virtual_lab.protocol.walking_study import study_texts
from tests.validation.ablation import SHORT
from tests.validation.table_3 import (
    CELLS,
    KEYS,
    LENGTHS_S,
    THESIS_SUBJECTS,
    after_onsets,
    cells_by_subject,
    process,
    process_study,
    removed,
)

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
LOW: Final = np.array([-1.0, -1.0, -1.0, -1.0, np.log(LENGTHS_S[0])])
HIGH: Final = np.array([1.0, 1.0, 1.0, 1.0, np.log(LENGTHS_S[-1])])
"""Ends of what was simulated: in units of `REACH`, and logarithms of the window [s]."""
CONFIDENCE: Final = 0.95
UNIFORM: Final = 12.0
"""Square of a uniform distribution's width over its variance."""
MAX_SHARE: Final = 0.5
"""Of the thesis' value: where more is allowed, agreement says nothing."""
PROTOCOL: Final = SHORT.model_copy(update={"calibration": "square_sway_60s_3mps"})
"""Three subjects' short trials, and a short calibration: what counts are differences."""


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

    ``logs`` are of a few subjects' means at the points of `DESIGN`, (15, windows, 36); by
    ``shift``, (windows, 36), those of all subjects exceed them where both were simulated;
    ``spread`` is the standard error of all subjects' means, (36,), as a share of a cell.
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


def respond(setting: Setting, reference: Array, jobs: int) -> dict[Pose, Response]:
    """Simulate a short study for every point of `DESIGN`; process each with and without the pose.

    Of the setting's protocol only the filter is used. ``reference`` are the cells by subject of
    this laboratory with its whole protocol, (subjects, windows, 36).
    """
    protocol = PROTOCOL.model_copy(update={"filter": setting.protocol.filter})
    short = setting.model_copy(update={"protocol": protocol})
    logs: dict[Pose, list[Array]] = {pose: [] for pose in POSES}
    for z in DESIGN:
        x = np.append(z, np.log(LENGTHS_S[0]))
        with TemporaryDirectory(prefix="hbm_") as folder:
            for pose in POSES:
                own = unstated_at(x, pose).apply(short)
                results = process_with(own, Path(folder), pose, jobs)
                cells = cells_by_subject(collect(results).residuals, after_onsets(results))
                logs[pose].append(np.log(cells.mean(axis=0)))
    level = reference.mean(axis=0)
    shift = np.log(level) - logs[POSES[0]][REFERENCE]
    spread = (reference.std(axis=0, ddof=1) / np.sqrt(len(reference)) / level).max(axis=0)
    return {pose: fit_response(np.stack(own), shift, spread) for pose, own in logs.items()}


def process_with(setting: Setting, folder: Path, pose: Pose, jobs: int) -> Path:
    """Simulate a study for the first of `POSES`, and process its recordings for each."""
    study = folder / "study"
    if pose == POSES[0]:
        return process(setting, folder, jobs)
    write_text(study_texts(setting)["study.toml"], study / "study.toml")
    return process_study(study, folder / pose, jobs)


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
    """

    value: Unstated
    low: Unstated
    high: Unstated
    at_edge: tuple[str, ...]
    misfit: dict[Pose, float]
    freedom: int
    predicted: dict[Pose, Array]
    error: Array


def estimate(responses: dict[Pose, Response], printed: pd.DataFrame) -> Estimate:
    """Estimate the unstated values from the cells without compensation, with the better pose.

    Weighted least squares; the error of a cell is that of the thesis' mean, of the simulated mean
    and of the polynomial, independent from cell to cell. Intervals are those of the linearised fit,
    widened by the root of the misfit per degree of freedom where that is above one (Birge 1932).
    What the cells hardly tell is known to be within what was simulated: as precisely as a uniform
    distribution over that range. As actuators and window act alike, the numbers are also fitted at
    each of `LENGTHS_S`; intervals hold those of every such fit that is as good as the error allows.
    """
    table = printed.set_index(KEYS).loc[CELLS]
    fits = {pose: _fits(response, table) for pose, response in responses.items()}
    misfit = {pose: float(2 * best.cost) for pose, (best, *_) in fits.items()}
    pose: Pose = min(fits, key=misfit.__getitem__)
    x, response = fits[pose][0].x, responses[pose]
    freedom = int(FITTED.sum()) - len(x)
    widening = max(1.0, misfit[pose] / freedom)
    quantile = student.ppf((1 + CONFIDENCE) / 2, freedom)
    prior = np.diag(UNIFORM / (HIGH - LOW) ** 2)
    as_good = [fit for fit in fits[pose] if 2 * fit.cost - misfit[pose] <= quantile**2 * widening]
    covariances = [np.linalg.pinv(fit.jac.T @ fit.jac / widening + prior) for fit in as_good]
    half = [quantile * np.sqrt(np.diag(covariance)) for covariance in covariances]
    ends = [
        np.clip([fit.x + side * own for fit, own in zip(as_good, half, strict=True)], LOW, HIGH)
        for side in (-1.0, 1.0)
    ]
    at_edge = np.isclose(x, LOW, atol=1e-3) | np.isclose(x, HIGH, atol=1e-3)
    apart = np.abs([response.at(fit.x) - response.at(x) for fit in as_good]).max(axis=0)
    slope = _slope(response, x)
    return Estimate(
        unstated_at(x, pose),
        unstated_at(ends[0].min(axis=0), pose),
        unstated_at(ends[1].max(axis=0), pose),
        tuple(name for name, at in zip(ESTIMATED, at_edge, strict=True) if at),
        misfit,
        freedom,
        {name: own.at(x) for name, own in responses.items()},
        np.sqrt(np.einsum("ci,ij,cj->c", slope, covariances[0], slope) + apart**2),
    )


def estimates_table(unstated: Estimate) -> pd.DataFrame:
    """Give each value with its interval, and the misfit of both poses."""
    ends = {"value": unstated.value, "low": unstated.low, "high": unstated.high}
    table = pd.DataFrame({name: asdict(own) for name, own in ends.items()})
    table = table.assign(at_edge=table.index.isin(unstated.at_edge)).rename_axis("name")
    for pose, misfit in unstated.misfit.items():
        table.loc[f"misfit, pose {pose}", "value"] = misfit
    return table.reset_index()


def _fits(response: Response, table: pd.DataFrame) -> list[OptimizeResult]:
    """Fit the numbers: the best fit, and the best ones at each of `LENGTHS_S`."""
    wanted, sd = table["mean"].to_numpy(), table["sd"].to_numpy()

    def misfit(x: Array) -> Array:
        cells = response.at(x)
        error = np.hypot(sd / np.sqrt(THESIS_SUBJECTS), response.error * cells)
        return np.asarray(((cells - wanted) / error)[FITTED])

    window, narrow = np.arange(len(LOW)) == ESTIMATED.index("window_s"), 1e-6
    found = []
    for length in np.log(LENGTHS_S):
        low, high = (
            np.where(window, length + d, end) for d, end in ((-narrow, LOW), (narrow, HIGH))
        )
        fits = [
            least_squares(misfit, [0.0, flexibility, 0.0, 0.0, length], bounds=(low, high))
            for flexibility in (-0.5, 0.5)
        ]
        found.append(min(fits, key=_cost))
    nearest = sorted(found, key=_cost)[:2]
    best = [
        least_squares(misfit, np.clip(fit.x, LOW, HIGH), bounds=(LOW, HIGH), x_scale="jac")
        for fit in nearest
    ]
    return [min(best, key=_cost), *found]


def _cost(fit: OptimizeResult) -> float:
    return float(fit.cost)


def _slope(response: Response, x: Array) -> Array:
    """Give the cells' derivatives by the estimated numbers, (36, 5)."""
    step = 1e-4 * np.maximum(1.0, np.abs(x))
    ends = [(response.at(x + d), response.at(x - d)) for d in np.diag(step)]
    return np.stack([(up - down) / (2 * s) for (up, down), s in zip(ends, step, strict=True)], 1)


def judge(
    simulated: Array, printed: pd.DataFrame, error: Array | None = None, freedom: int = 1
) -> pd.DataFrame:
    """Judge a simulated laboratory by the cells with compensation.

    ``simulated`` are its cells by subject, (subjects, 36); ``error`` is their standard error from
    what was estimated, (36,), with its degrees of freedom. A row per cell: ``tolerance``, by how
    much thesis and simulation may differ by chance in 95 % of such cells (Welch's test, degrees of
    freedom after Welch and Satterthwaite); ``undecided``, whether they do not differ by more but it
    exceeds `MAX_SHARE` of the thesis' value; ``explained``, whether they do not and it does not.
    """
    table = printed.set_index(KEYS).loc[CELLS]
    count = len(simulated)
    variances = np.stack(
        [
            table["sd"].to_numpy() ** 2 / THESIS_SUBJECTS,
            simulated.var(axis=0, ddof=1) / count,
            np.zeros(len(CELLS)) if error is None else error**2,
        ]
    )
    freedoms = np.array([THESIS_SUBJECTS - 1, count - 1, freedom])
    total = variances.sum(axis=0)
    joint = total**2 / (variances**2 / freedoms[:, None]).sum(axis=0)
    tolerance = student.ppf((1 + CONFIDENCE) / 2, joint) * np.sqrt(total)
    mean, thesis = simulated.mean(axis=0), table["mean"].to_numpy()
    near, sharp = np.abs(mean - thesis) <= tolerance, tolerance <= MAX_SHARE * thesis
    cells = CELLS.to_frame(index=False).assign(
        thesis=thesis,
        simulated=mean,
        tolerance=tolerance,
        explained=near & sharp,
        undecided=near & ~sharp,
        removed=CELLS.droplevel("compensated").isin(removed(printed)),
    )
    return cells[~FITTED].drop(columns="compensated").reset_index(drop=True)
