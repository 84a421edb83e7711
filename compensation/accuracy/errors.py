"""Errors between measured and true loads: by difference, about a line, of linearity."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import stdtrit

from compensation.inputs import read_signal, read_table, refuse_constant, refuse_unequal
from hbm.spatial import Array, read_only

MIN_COSINE: Final = 0.9
"""Between two signals of equal shape, whose sizes then show whether their units are equal."""
MAX_UNIT_RATIO: Final = 10.0
"""Between measured and true size, either way: no plate is that wrong, other units are."""
MIN_SINE: Final = 1e-12
"""Between the fitted line and the vertical; below it the line has no slope."""


def rms_difference(measured: ArrayLike, truth: ArrayLike) -> Array:
    """Give the root-mean-square difference of every channel.

    Parameters
    ----------
    measured, truth
        Equal quantities in equal units, (N, C).

    Returns
    -------
    Array
        RMSE, (C,), in their unit (van de Loosdrecht 2018, eq. 1).

    Raises
    ------
    ValueError
        Wrong shapes, no samples, gaps, or different numbers of samples or channels.

    Examples
    --------
    >>> rms_difference([[1.0], [2.0], [4.0]], [[1.0], [2.0], [3.0]]).round(3)
    array([0.577])
    """
    m, t = _read_pair(measured, truth)
    error: Array = np.sqrt(np.mean((m - t) ** 2, axis=0))
    return error


@dataclass(frozen=True, slots=True)
class Line:
    """A straight line ``measured = intercept + slope × truth`` and the scatter about it.

    `fit_line_orthogonal` fits one.

    Attributes
    ----------
    slope, intercept
        Of the line [1, unit].
    rmse
        Root-mean-square distance from the line, at right angles to it [unit].

    Examples
    --------
    >>> Line(slope=1.01, intercept=2.0, rmse=0.7).intercept
    2.0
    """

    slope: float
    intercept: float
    rmse: float


def fit_line_orthogonal(measured: ArrayLike, truth: ArrayLike) -> Line:
    """Fit a line by total least squares, which lets both measured and truth be in error.

    Parameters
    ----------
    measured, truth
        One quantity in one unit, (N,).

    Returns
    -------
    Line
        The line with the least squared orthogonal distances, and their RMS.

    Raises
    ------
    ValueError
        Wrong shapes, fewer than 3 samples, gaps, different lengths, or a constant channel.

    Notes
    -----
    The last right singular vector of the centred pairs is the line's normal, the last singular
    value the root of the summed squared distances (Golub and Van Loan 1980; Markovsky and Van
    Huffel 2007). Both channels are taken as equally uncertain. The RMS is that *about the fitted
    line*: an offset or a wrong scale of the plate is in `slope` and `intercept`, not in it.

    Examples
    --------
    >>> line = fit_line_orthogonal([1.0, 3.0, 5.0, 7.0], [0.0, 1.0, 2.0, 3.0])
    >>> f"{line.slope:.3f} {line.intercept:.3f}"
    '2.000 1.000'
    """
    m, t = read_signal(measured, "measured"), read_signal(truth, "truth")
    refuse_unequal(measured=m, truth=t)
    _refuse_other_scale(m[:, None], t[:, None])
    if len(m) < 3:
        raise ValueError(f"{len(m)} samples are too few for a line, give at least 3")
    refuse_constant(np.column_stack([m, t]), "the pair", ("measured", "truth"))
    center = np.array([t.mean(), m.mean()])
    _, s, vt = np.linalg.svd(np.column_stack([t, m]) - center, full_matrices=False)
    normal = vt[1]
    if abs(normal[1]) < MIN_SINE:
        raise ValueError("the line is vertical: the truth does not vary with what is measured")
    slope = -normal[0] / normal[1]
    rmse = s[1] / np.sqrt(len(m))
    return Line(float(slope), float(center[1] - slope * center[0]), float(rmse))


def rms_orthogonal(measured: ArrayLike, truth: ArrayLike) -> Array:
    """Give the orthogonal RMSE of every channel, (C,), as `fit_line_orthogonal`; shapes (N, C).

    Examples
    --------
    >>> rms_orthogonal([[1.0], [3.0], [5.0], [7.0]], [[0.0], [1.0], [2.0], [3.0]]).round(3) + 0.0
    array([0.])
    """
    m, t = _read_pair(measured, truth)
    return np.array([fit_line_orthogonal(*pair).rmse for pair in zip(m.T, t.T, strict=True)])


@dataclass(frozen=True, slots=True)
class Linearity:
    """How close to proportional a plate's output is to its load; `linearity` finds it.

    Attributes
    ----------
    slope, intercept
        Of the first-order fit [1, N].
    nonlinearity
        Three standard deviations of the residual of the first-order fit [N].
    percent_of_full_scale
        The same by the full scale output [%].
    r_squared_first, r_squared_second
        Of the first- and second-order fit [1].
    slope_error, degrees_of_freedom
        Standard error of the slope [1], recordings counting as independent, and its degrees of
        freedom.

    Examples
    --------
    >>> found = linearity([100.0, 200.0, 300.0, 400.0], [101.0, 201.0, 303.0, 403.0], 510.0)
    >>> f"{found.nonlinearity:.1f} N"
    '1.5 N'
    """

    slope: float
    intercept: float
    nonlinearity: float
    percent_of_full_scale: float
    r_squared_first: float
    r_squared_second: float
    slope_error: float = float("nan")
    degrees_of_freedom: int = 0

    @property
    def slope_uncertainty(self) -> float:
        """Half of the 95 % confidence interval of the slope, by Student's t [1]."""
        return float(stdtrit(self.degrees_of_freedom, 0.975) * self.slope_error)


def linearity(known: ArrayLike, measured: ArrayLike, full_scale: float) -> Linearity:
    """Compare known with measured loads by a straight line and by a parabola.

    Parameters
    ----------
    known, measured
        Loads, (N,) [N].
    full_scale
        Full scale output of the plate [N]; 510 N in the thesis.

    Returns
    -------
    Linearity
        Non-linearity and R² of both fits.

    Raises
    ------
    ValueError
        Wrong shapes, gaps, different lengths, fewer than 3 different loads, or a full scale that
        is not positive.

    Notes
    -----
    Ordinary least squares of measured on known; three standard deviations (with ``N - 1``) stand
    for the largest deviation without its outliers (van de Loosdrecht 2018, A.4 and D.1.4).

    Examples
    --------
    >>> found = linearity([100.0, 200.0, 300.0, 400.0], [101.0, 201.0, 303.0, 403.0], 510.0)
    >>> f"slope {found.slope:.3f}, non-linearity {found.percent_of_full_scale:.2f} % of full scale"
    'slope 1.008, non-linearity 0.30 % of full scale'
    """
    x, y = read_signal(known, "known loads"), read_signal(measured, "measured loads")
    refuse_unequal(known_loads=x, measured_loads=y)
    if len(np.unique(x)) < 3 or len(x) < 4:
        raise ValueError(
            f"{len(x)} measurements of {len(np.unique(x))} known loads; "
            "linearity needs at least 4 of 3 different loads"
        )
    refuse_constant(y[:, None], "measured loads", ("their only channel",))
    _refuse_other_scale(y[:, None], x[:, None])
    if not full_scale > 0:
        raise ValueError(f"full_scale must be a positive load in N, got {full_scale}")
    first, second = (np.polynomial.Polynomial.fit(x, y, degree) for degree in (1, 2))
    rest = y - first(x)
    nonlinearity = 3 * float(np.std(rest, ddof=1))
    freedom = len(x) - 2
    variance = np.sum(rest**2) / freedom / np.sum((x - x.mean()) ** 2)
    r_squared = [
        1 - float(np.sum((y - fit(x)) ** 2) / np.sum((y - y.mean()) ** 2))
        for fit in (first, second)
    ]
    return Linearity(
        float(first.deriv()(0.0)),
        float(first(0.0)),
        nonlinearity,
        100 * nonlinearity / full_scale,
        r_squared_first=r_squared[0],
        r_squared_second=r_squared[1],
        slope_error=float(np.sqrt(variance)),
        degrees_of_freedom=freedom,
    )


def mean_by_level(
    errors: ArrayLike, factors: Mapping[str, Sequence[str | float]]
) -> dict[str, dict[str | float, Array]]:
    """Average the errors of trials per level of every factor, as in the thesis' Table I.

    Parameters
    ----------
    errors
        One row per trial, (N, C).
    factors
        Factor name -> its level in every trial, N entries: speed, position, weight, …

    Returns
    -------
    dict
        Factor -> level -> mean errors, (C,); levels in order of appearance.

    Raises
    ------
    ValueError
        Wrong shape, no trials, gaps, or a factor with another number of entries.

    Examples
    --------
    >>> mean_by_level([[1.0], [3.0], [8.0]], {"belt": ["left", "left", "right"]})
    {'belt': {'left': array([2.]), 'right': array([8.])}}
    """
    table = read_table(errors, "errors")
    for name, levels in factors.items():
        if len(levels) != len(table):
            raise ValueError(f"factor {name!r} has {len(levels)} levels for {len(table)} trials")
    return {
        name: {
            level: read_only(table[[each == level for each in levels]].mean(axis=0))
            for level in dict.fromkeys(levels)
        }
        for name, levels in factors.items()
    }


def _read_pair(measured: ArrayLike, truth: ArrayLike) -> tuple[Array, Array]:
    m, t = read_table(measured, "measured"), read_table(truth, "truth")
    refuse_unequal(measured=m, truth=t)
    if m.shape != t.shape:
        raise ValueError(f"measured has {m.shape[1]} channels, truth {t.shape[1]}")
    _refuse_other_scale(m, t)
    return m, t


def _refuse_other_scale(m: Array, t: Array) -> None:
    """Raise a ValueError where measured and truth have equal shape, but not equal units."""
    sizes = np.linalg.norm(m, axis=0), np.linalg.norm(t, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        alike = np.abs(np.sum(m * t, axis=0)) / (sizes[0] * sizes[1]) > MIN_COSINE
        ratio = sizes[0] / sizes[1]
    other = alike & ((ratio > MAX_UNIT_RATIO) | (ratio < 1 / MAX_UNIT_RATIO))
    if other.any():
        channel = int(np.argmax(other))
        raise ValueError(
            f"measured is {ratio[channel]:.3g} times the truth in channel {channel + 1}; "
            "are both in one unit?"
        )
