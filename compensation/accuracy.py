"""Known weights against force plates: how far off, how straight, and where."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from compensation.inputs import (
    read_rate,
    read_signal,
    read_table,
    refuse_constant,
    refuse_unequal,
)
from hbm.spatial import GRAVITY_MPS2, Array, read_only

_FASTEST = 50.0  # m/s²: no weight on a belt is accelerated more
_ALIKE = 0.9  # cosine between two signals of one shape


def wrench_of_weight(
    mass_kg: float, marker: ArrayLike, rate_hz: float, center_height_m: float
) -> Array:
    """Give the wrench that a plate should measure under a weight with a marker on top.

    Parameters
    ----------
    mass_kg
        Mass of the weight [kg].
    marker
        Low-passed positions of the marker above the weight's middle, lab axes, (T, 3) [m].
    rate_hz
        Their sampling rate [Hz].
    center_height_m
        Height of the weight's centre of mass in the lab while it stands still [m]; 0 is the
        thesis' truth, in which the centre of pressure is below the marker.

    Returns
    -------
    Array
        Action of the plate on the weight, lab axes about the lab origin, (T, 6) [N, N·m]: force
        ``m (a - g)`` with the twice differentiated marker, through the centre of mass.

    Raises
    ------
    ValueError
        Wrong shape, fewer than 3 samples, gaps, a mass that is not positive, or positions that
        are not in metres.

    Notes
    -----
    Truth of van de Loosdrecht (2018), II.A and D.1. The weight does not turn, so the force goes
    through its centre of mass, which moves with the marker.
    """
    position, rate = read_table(marker, "marker", 3), read_rate(rate_hz)
    if len(position) < 3:
        raise ValueError(f"marker has {len(position)} samples; an acceleration needs at least 3")
    if not 0 < mass_kg < 1000:
        raise ValueError(f"mass_kg must be a weight in kilograms up to 1000, got {mass_kg}")
    acceleration = np.gradient(np.gradient(position, 1 / rate, axis=0), 1 / rate, axis=0)
    fastest = float(np.median(np.linalg.norm(acceleration, axis=1)))
    if np.max(np.abs(position)) > 20 or fastest > _FASTEST:
        raise ValueError(
            f"marker lies {np.max(np.abs(position)):.3g} m away and is accelerated by "
            f"{fastest:.3g} m/s²; is it in metres and low-passed?"
        )
    force = mass_kg * (acceleration + np.array([0, 0, GRAVITY_MPS2]))
    rise = position[:, 2] - position[0, 2]
    center = np.column_stack([position[:, :2], center_height_m + rise])
    return np.hstack([force, np.cross(center, force)])


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
    """
    m, t = _read_pair(measured, truth)
    error: Array = np.sqrt(np.mean((m - t) ** 2, axis=0))
    return error


@dataclass(frozen=True, slots=True)
class Line:
    """A straight line ``measured = intercept + slope × truth`` and the scatter about it.

    Attributes
    ----------
    slope, intercept
        Of the line [1, unit].
    rmse
        Root-mean-square distance from the line, at right angles to it [unit].
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
    Huffel 2007). Both channels count as equally uncertain. The RMS is that *about the fitted line*:
    an offset or a wrong scale of the plate is in `slope` and `intercept`, not in it.
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
    if abs(normal[1]) < 1e-12:
        raise ValueError("the line is vertical: the truth does not vary with what is measured")
    slope = -normal[0] / normal[1]
    rmse = s[1] / np.sqrt(len(m))
    return Line(float(slope), float(center[1] - slope * center[0]), float(rmse))


def rms_orthogonal(measured: ArrayLike, truth: ArrayLike) -> Array:
    """Give the orthogonal RMSE of every channel, (C,), as `fit_line_orthogonal`; shapes (N, C)."""
    m, t = _read_pair(measured, truth)
    return np.array([fit_line_orthogonal(*pair).rmse for pair in zip(m.T, t.T, strict=True)])


@dataclass(frozen=True, slots=True)
class Linearity:
    """How straight a plate answers to load.

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
    """

    slope: float
    intercept: float
    nonlinearity: float
    percent_of_full_scale: float
    r_squared_first: float
    r_squared_second: float


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
    nonlinearity = 3 * float(np.std(y - first(x), ddof=1))
    return Linearity(
        float(first.deriv()(0.0)),
        float(first(0.0)),
        nonlinearity,
        100 * nonlinearity / full_scale,
        *(
            1 - float(np.sum((y - fit(x)) ** 2) / np.sum((y - y.mean()) ** 2))
            for fit in (first, second)
        ),
    )


def mean_by_level(
    errors: ArrayLike, factors: Mapping[str, Sequence[object]]
) -> dict[str, dict[object, Array]]:
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
    """Raise a ValueError where measured and truth have one shape but not one unit."""
    sizes = np.linalg.norm(m, axis=0), np.linalg.norm(t, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        alike = np.abs(np.sum(m * t, axis=0)) / (sizes[0] * sizes[1]) > _ALIKE
        ratio = sizes[0] / sizes[1]
    odd = np.flatnonzero(alike & ((ratio > 10) | (ratio < 0.1)))
    if len(odd):
        raise ValueError(
            f"measured is {ratio[odd[0]]:.3g} times the truth in channel {odd[0] + 1}; "
            "are both in one unit?"
        )
