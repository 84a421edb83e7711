"""What a plate reports of a true wrench: its single faults, and its total error in walking."""

from collections.abc import Collection, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from itertools import product
from typing import Final

import numpy as np
from scipy import stats
from scipy.interpolate import CubicSpline
from scipy.signal import czt

from compensation import Delay, PlateCalibration, center_of_pressure
from compensation.accuracy import PlateAlignment
from hbm.spatial import GRAVITY_MPS2, WRENCH_COMPONENTS, Array, Mask, shift_wrench
from pipeline.config.plate_study import BeltSide, PlatesFile
from pipeline.plate_accuracy.trials import LOADED_SHARE, WeightTrial, to_cameras

FX, FY, FZ, MX, MY, MZ = range(6)
EXCITED: Final = (FX, FZ, MX, MY, MZ)
"""Components that a weight on a belt excites; no lateral force acts on it."""
EXCITED_BY_POSITION: Final = (MX, MZ)
"""Of these, those that only weights at different distances from the belt's middle excite."""
EXCITED_BY_ACCELERATION: Final = (FX, MZ)
"""Of these, those that only belts at changing speed excite."""
MIN_MASSES: Final = 3
"""Of different size, to separate a curvature from a gain."""
MIN_SHARE: Final = 0.01
"""Of a variance, left where the marker's noise explains more than all of it."""
MIN_VARIANCE: Final = 1e-12
"""[N², (N·m)²]; of a channel that is not connected it is zero."""
MIN_SINES: Final = 4
"""Recordings in which the weight moves in a sine, for the scatter from them alone."""
EDGE_S: Final = 1.0
"""At either end of a recording, where filters at 2.4 Hz are inaccurate."""
DELAY_STEPS: Final = 2
"""Of Newton's method: the regression is linear in the delay but for what it does to other terms."""


@dataclass(frozen=True, slots=True)
class PlateResponse:
    """What a plate reports, in lab axes about the centre of its surface, given the true wrench.

    ``reported(t + delay) = (matrix + rise Fz / full scale) @ true(t) + zero + drift t``, and
    scatter about it of variance ``scatter[0] + scatter[1] Fz²``.

    Every array begins with K entries: from all n recordings, then without each of them in turn
    (jackknife, K = n + 1), from which `standard_error` makes that of any function of them.

    Attributes
    ----------
    matrix
        From true to reported wrench, (K, 6, 6). Columns of components that were not examined are
        those of a plate that is only turned and shifted, by its static calibration.
    aligned
        The same after static calibration, (K, 6, 6).
    zero
        Reported by the unloaded plate at the beginning of a recording, (K, 6) [N, N·m].
    drift
        (K, 6) [N/s, N·m/s].
    rise
        By how much the matrix grows until full scale, (K, 6, 6); NaN where fewer than three masses
        were recorded.
    delay_s
        (K,) [s].
    scatter
        (K, 2, 6) [N², (N·m)²; 1, m²].
    examined
        Components of the true wrench that varied.
    degrees_of_freedom
        Recordings less coefficients.
    full_scale_n
        Load at which the rise is given [N].
    """

    matrix: Array
    aligned: Array
    zero: Array
    drift: Array
    rise: Array
    delay_s: Array
    scatter: Array
    examined: tuple[int, ...]
    degrees_of_freedom: int
    full_scale_n: float

    def report(self, loads: Array) -> Array:
        """Give what is reported of true wrenches, (L, 6), without drift and scatter, (K, L, 6)."""
        risen = loads * loads[:, FZ, None] / self.full_scale_n
        reported = loads @ self.matrix.swapaxes(1, 2) + self.zero[:, None]
        return np.asarray(reported + risen @ np.nan_to_num(self.rise).swapaxes(1, 2))

    @property
    def complete(self) -> bool:
        """True if nothing is unknown that the load of a person depends on, but lateral force."""
        return self.examined == EXCITED and bool(np.isfinite(self.rise).all())

    @property
    def quantile(self) -> float:
        """Half the width of a 95 % confidence interval, in standard errors (Student's t)."""
        return float(stats.t.isf(0.025, self.degrees_of_freedom))


def standard_error(replicates: Array) -> Array:
    """Give the jackknife's standard error of what was computed from (K, …) entries."""
    count = len(replicates) - 1
    off = replicates[1:] - replicates[0]
    return np.asarray(np.sqrt((count - 1) / count * np.sum(off**2, axis=0)))


def fit_response(
    trials: Sequence[WeightTrial], alignment: PlateAlignment, file: PlatesFile
) -> PlateResponse | None:
    """Find what a plate reports of the true wrenches of its recordings.

    Parameters
    ----------
    trials
        Recordings on one plate, as it is used.
    alignment
        Static calibration by which their wrenches were brought to the cameras' frame.
    file
        With the full scale, at which the rise of the gains is given, and whether the height of the
        weights' centre of mass is known. A wrong height looks like a moment about the lateral axis
        from the force along the belt, which is left out then.

    Returns
    -------
    PlateResponse or None
        None where there are too few recordings for the coefficients.

    Notes
    -----
    Least squares over all recordings at 2.4 Hz. The regressors are a constant, time, the true
    wrench, the rate of change of its largest moment (a delay) and the true wrench times the load
    (gains that rise with it, where a rise shows), all at once.
    Recordings, not samples, are independent: the jackknife leaves out one at a time (Efron and
    Tibshirani 1993, chapter 11). The scatter is that of the wrench at the study's cut-off about
    what these coefficients predict from the slow marker, less what the marker's noise adds to it.
    """
    positions = len({trial.weight.position_m for trial in trials}) > 1
    masses = len({trial.weight.mass_kg for trial in trials})
    changing = any(trial.weight.profile != "constant" for trial in trials)
    excited = tuple(
        c
        for c in EXCITED
        if (positions or c not in EXCITED_BY_POSITION)
        and (changing or c not in EXCITED_BY_ACCELERATION)
        and (masses > 1 or c != FZ)
    )
    model = _Model(excited, (FZ,) if masses >= MIN_MASSES else (), file.full_scale_n)
    if len(trials) <= model.coefficients:
        return None
    model = replace(model, rising=(*model.rising, *_rising(trials, model)))
    found, delay_s = _regress_with_delay(trials, model)
    aligned = np.tile(np.eye(6), (len(found), 1, 1))
    aligned[:, :, excited] += found[:, 2 : model.delay].swapaxes(1, 2)
    in_use, rise = aligned.copy(), np.full_like(aligned, 0.0 if model.rising else np.nan)
    rise[:, :, model.rising] = found[:, model.delay + 1 :].swapaxes(1, 2)
    if not file.height_stated:
        in_use[:, MY, FX] = rise[:, MY, FX] = 0
    as_read = np.linalg.inv(cameras_matrix(alignment, trials[0].center))
    return PlateResponse(
        matrix=as_read @ in_use,
        aligned=aligned,
        zero=found[:, 0] @ as_read.T,
        drift=found[:, 1] @ as_read.T,
        rise=as_read @ rise,
        delay_s=delay_s,
        scatter=_scatter(trials, found, model, float(delay_s[0])),
        examined=excited,
        degrees_of_freedom=len(trials) - model.coefficients,
        full_scale_n=file.full_scale_n,
    )


def cameras_matrix(alignment: PlateAlignment, center: Array) -> Array:
    """Give the matrix that brings a plate's wrench about its centre to the cameras' frame."""
    at_origin = to_cameras(shift_wrench(np.eye(6), -center), alignment)
    return np.asarray(shift_wrench(at_origin, center).T)


@dataclass(frozen=True, slots=True)
class _Model:
    """What a regression contains: components, those whose gain rises with the load, by full scale.

    Its coefficients are a constant, time, the components, a delay, and the rises.
    """

    excited: tuple[int, ...]
    rising: tuple[int, ...]
    full_scale_n: float

    @property
    def delay(self) -> int:
        """The number of the delay's coefficient."""
        return 2 + len(self.excited)

    @property
    def coefficients(self) -> int:
        """How many there are."""
        return self.delay + 1 + len(self.rising)

    def regressors(self, trial: WeightTrial) -> Array:
        """Give the columns of a recording, (T, coefficients)."""
        truth, time = trial.slow_truth, trial.time
        risen = truth[:, self.rising] * truth[:, FZ, None] / self.full_scale_n
        constant, rate = np.ones(len(time)), -np.gradient(truth[:, MY], time)
        return np.column_stack([constant, time - time[0], truth[:, self.excited], rate, risen])


def _rising(trials: Sequence[WeightTrial], model: _Model) -> tuple[int, ...]:
    """Find the components, one by one, of which a gain rises or falls significantly with the load.

    Gains of which no rise shows are taken as constant: a rise in vain would cost precision.
    """
    others = [c for c in model.excited if model.rising and c not in model.rising]
    freedom = len(trials) - model.coefficients - 1
    rising = []
    for c in others if freedom > 0 else ():
        rises = _regress_with_delay(trials, replace(model, rising=(*model.rising, c)))[0][:, -1]
        critical = stats.t.isf(ALPHA / 2 / (len(others) * rises.shape[1]), freedom)
        if np.any(np.abs(rises[0]) > critical * standard_error(rises)):
            rising.append(c)
    return tuple(rising[:freedom])


def _regress_with_delay(trials: Sequence[WeightTrial], model: _Model) -> tuple[Array, Array]:
    """Give the coefficients of all components, (K, coefficients, 6), and the delay, (K,)."""
    delay_s = np.zeros(len(trials) + 1)
    for _ in range(DELAY_STEPS):
        found = _regress(trials, model, delay_s[0])
        gain = 1 + found[:, 2 + model.excited.index(MY), MY]
        delay_s = delay_s[0] + found[:, model.delay, MY] / gain
    return found, delay_s


def _inside(trial: WeightTrial, edge_s: float = EDGE_S) -> Mask:
    first, last = trial.time[0] + edge_s, trial.time[-1] - edge_s
    return np.asarray((trial.time > first) & (trial.time < last))


def _regress(trials: Sequence[WeightTrial], model: _Model, delay_s: float) -> Array:
    """Give the coefficients of all components, (K, coefficients, 6), with a delay so far."""
    x, y = [], []
    for trial in trials:
        inside = _inside(trial)
        at = trial.time[inside] + delay_s
        measured = CubicSpline(trial.time, trial.slow_measured)(at)
        x.append(model.regressors(trial)[inside])
        y.append(measured - trial.slow_truth[inside])
    size = np.sqrt(np.mean(np.vstack(x) ** 2, axis=0))
    size[size == 0] = 1
    gram = np.array([(one / size).T @ (one / size) for one in x])
    cross = np.array([(one / size).T @ other for one, other in zip(x, y, strict=True)])
    grams = np.concatenate([gram.sum(0)[None], gram.sum(0) - gram])
    crosses = np.concatenate([cross.sum(0)[None], cross.sum(0) - cross])
    solved = np.linalg.pinv(grams, hermitian=True) @ crosses
    return np.asarray(solved / size[:, None])


def _scatter(trials: Sequence[WeightTrial], found: Array, model: _Model, delay_s: float) -> Array:
    """Give the variance about the response that every load has, and that growing with it.

    Where enough weights move in sines, only those count: low-passed at 2.4 Hz, the truth of others
    lacks much of what happens where the belt turns back.
    """
    sines = np.array([trial.weight.profile == "sine" for trial in trials])
    counted = sines if np.count_nonzero(sines) >= MIN_SINES else np.ones(len(trials), bool)
    variance, load = [], []
    for trial in trials:
        chosen = trial.used & _inside(trial)
        chosen = chosen if chosen.any() else trial.used
        x = model.regressors(trial)
        x[:, model.delay] = 0
        predicted = trial.slow_truth + x @ found[0]
        late = CubicSpline(trial.time, predicted)(trial.time - delay_s)
        rest = shift_wrench(trial.measured, trial.center) - late
        square = np.mean(rest[chosen] ** 2, axis=0)
        least = np.maximum(MIN_SHARE * square, MIN_VARIANCE)
        variance.append(np.maximum(square - trial.slow_noise**2, least))
        load.append(np.mean(trial.slow_truth[chosen, FZ]))
    spread, basis = np.array(variance), np.column_stack([np.ones(len(load)), np.square(load)])

    def fitted(rows: Mask) -> list[Array]:
        ones = np.ones(np.count_nonzero(rows))
        return [np.linalg.lstsq(basis[rows] / v[rows, None], ones)[0] for v in spread.T]

    without_one = counted & ~np.eye(len(trials), dtype=bool)
    return np.array([np.column_stack(fitted(rows)) for rows in (counted, *without_one)])


PHASES: Final = ((-0.25, 1.2), (0.0, 0.75), (0.25, 1.2))
"""Forward and vertical force of one foot in body weights: braking, midstance, push-off. Vertical
peaks are 1.2 body weights in walking at 1.5 m/s (Keller et al. 1996, Clin Biomech 11:253); the
others are those of the virtual laboratory's subjects at 1.3 m/s (tests/validation/realism.md)."""
PEAK: Final = max(up for _, up in PHASES)
LATERAL: Final = (-0.05, 0.05)
"""Lateral force of one foot in body weights: assumed."""
ALONG_M: Final = (-0.4, 0.0, 0.4)
ACROSS_M: Final = (-0.1, 0.0, 0.1)
"""Centres of pressure from the middle of the plate: where feet are on a treadmill's belt; assumed,
and within what the thesis' weights cover."""
BODY_CENTER_M: Final = 1.0
"""Height of a person's centre of mass, about which the error of the moment is judged."""
RECORDING_S: Final = 60.0
"""Time over which a drift acts: a minute of walking after the plate was zeroed."""
NODES_S: Final = RECORDING_S / 2 * (1 + np.array([-1.0, 1.0]) / np.sqrt(3.0))
QUANTITIES: Final = ("Fx", "Fy", "Fz", "COPx", "COPy", "Mx", "My", "Mz")


def stance_loads(body_mass_kg: float) -> Array:
    """Give wrenches of one foot about the centre of a plate's surface, (L, 6) [N, N·m].

    Examples
    --------
    >>> stance_loads(75.0).shape
    (54, 6)
    """
    weight = body_mass_kg * GRAVITY_MPS2
    cases = list(product(PHASES, LATERAL, ALONG_M, ACROSS_M))
    force = weight * np.array([(forward, lateral, up) for (forward, up), lateral, _, _ in cases])
    place = np.array([(x, y, 0.0) for _, _, x, y in cases])
    return np.hstack([force, np.cross(place, force)])


def quantities_of(components: Collection[int]) -> tuple[str, ...]:
    """Give the quantities on which an error of these components of a wrench acts.

    Examples
    --------
    >>> quantities_of([FY])
    ('Fy', 'Mx', 'Mz')
    """
    loads = stance_loads(1.0)
    effect = _effects(loads, loads[None])[..., list(components)]
    return tuple(name for k, name in enumerate(QUANTITIES) if effect[:, :, k].any())


def total_errors(
    response: PlateResponse, loads: Array, calibration: PlateCalibration | None = None
) -> tuple[Array, Array, Array]:
    """Find the errors of a plate under given loads: what it reports less the truth.

    Parameters
    ----------
    response
        Of the plate.
    loads
        True wrenches about the centre of its surface, (L, 6) [N, N·m].
    calibration
        Applied to what it reports; without, as reported.

    Returns
    -------
    size, low, high
        Root mean squares over the loads with their 95 % intervals, (8,) each for `QUANTITIES`:
        forces [N], centres of pressure [m], moments about the person's centre of mass, 1 m above
        the load [N·m]. Systematic error, drift of a minute and scatter together. A delay is an
        error of time and not in it.

    Notes
    -----
    The interval of the systematic part is its RMS ± Student's t times the RMS of its standard
    error, over the loads: by the triangle inequality the RMS cannot be off by more than the RMS of
    what it is estimated wrongly by, which holds where the error is near zero too. The mean square
    over a minute is exact at the two nodes of Gauss and Legendre, as the drift is linear.
    """
    loads = np.repeat(loads, len(NODES_S), axis=0)
    times = np.resize(NODES_S, len(loads))
    reported = response.report(loads) + times[:, None] * response.drift[:, None]
    variance = response.scatter[:, 0, None] + response.scatter[:, 1, None] * loads[:, FZ, None] ** 2
    if calibration is not None:
        reported = calibration.correct(reported)
        variance = variance @ (calibration.matrix**2).T
    variance = np.maximum(variance, 0)
    effect = _effects(loads, reported)
    error = np.einsum("klqc,klc->klq", effect, reported - loads)
    random = np.einsum("klqc,klc->klq", effect**2, variance).mean(axis=1)
    systematic, unsure = rms(error[0]), response.quantile * rms(standard_error(error))
    wide = response.quantile * standard_error(random)
    return (
        np.sqrt(systematic**2 + random[0]),
        np.sqrt(np.maximum(systematic - unsure, 0) ** 2 + np.maximum(random[0] - wide, 0)),
        np.sqrt((systematic + unsure) ** 2 + random[0] + wide),
    )


def rms(errors: Array) -> Array:
    """Give root mean squares of errors (n, …), (…)."""
    return np.asarray(np.sqrt(np.mean(errors**2, axis=0)))


def _effects(loads: Array, reported: Array) -> Array:
    """Give what an error of each component does to each quantity, (K, L, 8, 6)."""
    x, y = -loads[:, MY] / loads[:, FZ], loads[:, MX] / loads[:, FZ]
    effect = np.zeros((*reported.shape[:2], len(QUANTITIES), 6))
    effect[..., range(3), range(3)] = 1
    effect[..., 3, MY], effect[..., 3, FZ] = -1 / reported[..., FZ], -x / reported[..., FZ]
    effect[..., 4, MX], effect[..., 4, FZ] = 1 / reported[..., FZ], -y / reported[..., FZ]
    effect[..., 5, MX], effect[..., 5, FZ], effect[..., 5, FY] = 1, -y, BODY_CENTER_M
    effect[..., 6, MY], effect[..., 6, FZ], effect[..., 6, FX] = 1, x, -BODY_CENTER_M
    effect[..., 7, MZ], effect[..., 7, FX], effect[..., 7, FY] = 1, y, -x
    return effect


MIN_HZ: Final = 0.5
MAX_HZ: Final = 15.0
"""Below, the motion of the weight; above, the low-pass at 20 Hz."""
STEP_HZ: Final = 0.05
"""Of the spectrum: a fifth of the width of a line in 4 s."""
NEIGHBOURS: Final = 40
"""Frequencies on either side, 2 Hz, whose median is the noise at a frequency."""
NEAR_HZ: Final = 0.2
"""Distance from the common peak at which a recording's own is sought."""
FINE_STEP_HZ: Final = 0.002
"""Of that search: below any uncertainty of a frequency."""
MAX_SPREAD_HZ: Final = NEAR_HZ / 4
"""Standard deviation of the recordings' frequencies; noise spreads over all of ± `NEAR_HZ`."""
LINE_ALPHA: Final = 0.01
"""Chance that noise alone shows a line, over all frequencies."""
FILTER_EDGE_S: Final = 0.5
"""At either end of a recording, where its filters are inaccurate."""


def find_vibration(trials: Sequence[WeightTrial]) -> tuple[float, float, float] | None:
    """Find the strongest line in the centre of pressure along the belt, if there is one.

    Of recordings on one plate, equal in their supports: its amplitude [m], the standard error of
    that over recordings, and the frequency [Hz]. None where no line from 0.5 to 15 Hz exceeds its
    surroundings significantly (1 % over all frequencies), with fewer than two recordings, or where
    a true load is at times so small that it has no centre of pressure (the marker's noise exceeds
    a weight's acceleration).

    The regression on the marker's position, speed and acceleration is subtracted first: gains and
    delays are no vibration. The spectra of all recordings are averaged; the median of the
    frequencies around is the noise. The line must be at one frequency in all recordings.
    """
    if len(trials) < 2:
        return None
    paths = [_beyond_motion(trial) for trial in trials]
    hz = np.arange(MIN_HZ, MAX_HZ, STEP_HZ)
    power = np.mean([_power(time, value, hz) for time, value, _ in paths], axis=0)
    if not np.isfinite(power).all():
        return None
    floor = np.array(
        [np.median(power[max(k - NEIGHBOURS, 0) : k + NEIGHBOURS + 1]) for k in range(len(hz))]
    )
    freedom = 2 * len(trials)
    chance = stats.chi2.isf(LINE_ALPHA / len(hz), freedom) / stats.chi2.median(freedom)
    peak = int(np.argmax(power / floor))
    near = np.arange(hz[peak] - NEAR_HZ, hz[peak] + NEAR_HZ, FINE_STEP_HZ)
    own = np.array([near[np.argmax(_power(time, value, near))] for time, value, _ in paths])
    if power[peak] < chance * floor[peak] or own.std(ddof=1) > MAX_SPREAD_HZ:
        return None
    middle = float(np.mean(own))
    amplitudes = []
    for time, value, motion in paths:
        angle = 2 * np.pi * middle * time
        waves = np.column_stack([np.cos(angle), np.sin(angle), motion])
        amplitudes.append(np.hypot(*np.linalg.lstsq(waves, value)[0][:2]))
    error = np.std(amplitudes, ddof=1) / np.sqrt(len(trials))
    return float(np.mean(amplitudes)), float(error), middle


def _beyond_motion(trial: WeightTrial) -> tuple[Array, Array, Array]:
    """Give times, the centre of pressure minus its regression on the motion, and the motion."""
    inside = _inside(trial, FILTER_EDGE_S)
    load = LOADED_SHARE * float(np.median(trial.truth[:, 2]))
    measured, true = (center_of_pressure(w, load)[:, 0] for w in (trial.measured, trial.truth))
    x = trial.slow_marker[:, 0]  # noise of a faster marker would bias the regression
    v = np.gradient(x, trial.time)
    motion = np.column_stack([np.ones(len(x)), trial.time, x, v, np.gradient(v, trial.time)])
    motion = motion[inside]
    value = (measured - true)[inside]
    return trial.time[inside], value - motion @ np.linalg.lstsq(motion, value)[0], motion


def _power(time: Array, signal: Array, hz: Array) -> Array:
    """Squared amplitude of the sine of every frequency, equally spaced, in a signal."""
    turn = 2j * np.pi * (time[1] - time[0])
    spectrum = czt(signal, len(hz), np.exp(-turn * (hz[1] - hz[0])), np.exp(turn * hz[0]))
    return np.asarray(np.abs(2 / len(signal) * spectrum) ** 2)


LEFT_OUT: Final = {(MX, FZ), (MY, FZ), (MX, MY), (MY, MX)}
"""Cross-talk that a rotated or shifted plate causes too: it counts as that, and in total errors."""
OF_HEIGHT: Final = (MY, FX)
"""Cross-talk that a misstated height of the weights causes too."""
ALPHA: Final = 0.05
"""Level of significance of all faults of all plates together."""
ALIGNMENT_STEP: Final = 1e-6
"""Of angle [rad] and offset [m], for the derivative of what they do to a wrench."""


@dataclass(frozen=True, slots=True)
class FaultEstimate:
    """One property of a plate that should be zero.

    Attributes
    ----------
    belt
        The plate.
    fault
        "angle", "offset along", "delay", "gain of Fz", "Fz in Fx", "zero of Fz", "curvature",
        "drift", "vibration with supports", ….
    value, standard_error
        Estimate and its standard error.
    unit
        Of both.
    degrees_of_freedom
        Of the standard error.
    significant
        True if it differs from zero at 5 %, all faults of all plates tested together (Bonferroni).
    frequency_hz
        Of a vibration; else NaN.
    """

    belt: BeltSide
    fault: str
    value: float
    standard_error: float
    unit: str
    degrees_of_freedom: float
    significant: bool = False
    frequency_hz: float = np.nan

    @property
    def uncertainty(self) -> float:
        """Half of the 95 % confidence interval, by Student's t."""
        return float(stats.t.isf(0.025, self.degrees_of_freedom) * self.standard_error)


def estimate_faults(
    trials: Sequence[WeightTrial],
    responses: Mapping[BeltSide, PlateResponse],
    alignments: Mapping[BeltSide, PlateAlignment],
    delays: Mapping[BeltSide, Delay],
    *,
    height_stated: bool,
) -> tuple[FaultEstimate, ...]:
    """Estimate all faults of all plates, tested together at 5 % (Bonferroni).

    A vibration is listed only where there is one, and the moment about the lateral axis that the
    force along the belt causes only where the height of the weights is known.
    """
    estimates: list[tuple[BeltSide, str, float, float, str, float]] = []
    for belt, alignment in alignments.items():
        (along, across), errors = alignment.offset, alignment.standard_error
        degrees = np.degrees(alignment.angle), np.degrees(errors[0])
        estimates += [
            (belt, "angle", *degrees, "°", np.inf),
            (belt, "offset along", along, errors[1], "m", np.inf),
            (belt, "offset across", across, errors[2], "m", np.inf),
        ]
    for belt, delay in delays.items():
        size = delay.seconds, delay.standard_error
        estimates.append((belt, "delay", *size, "s", delay.degrees_of_freedom))
    centers = {trial.weight.belt: trial.center for trial in trials}
    left_out = LEFT_OUT if height_stated else LEFT_OUT | {OF_HEIGHT}
    for belt, response in responses.items():
        unsure = np.zeros((6, 6))
        if belt in alignments:
            unsure = _errors_of_alignment(response, alignments[belt], centers[belt])
        singles = _response_faults(response, unsure, left_out)
        estimates += [(belt, *single, response.degrees_of_freedom) for single in singles]
    found = []
    for belt, name, value, error, unit, freedom in estimates:
        critical = stats.t.isf(ALPHA / 2 / len(estimates), freedom)
        beyond = bool(abs(value) > critical * error)
        found.append(FaultEstimate(belt, name, float(value), float(error), unit, freedom, beyond))
    for belt, (supports, words) in product(centers, ((True, "with"), (False, "without"))):
        alike = [t for t in trials if (t.weight.belt, t.weight.supports) == (belt, supports)]
        line = find_vibration(alike)
        if line is not None:
            name, freedom = f"vibration {words} supports", len(alike) - 1
            found.append(FaultEstimate(belt, name, *line[:2], "m", freedom, True, line[2]))
    return tuple(found)


def _errors_of_alignment(
    response: PlateResponse, alignment: PlateAlignment, center: Array
) -> Array:
    """Give what the uncertainty of the static calibration adds to that of the matrix, (6, 6)."""
    changes = []
    for step in ALIGNMENT_STEP * np.eye(3):
        turned = replace(alignment, angle=alignment.angle + step[0])
        moved = replace(turned, offset=alignment.offset + step[1:])
        change = cameras_matrix(moved, center) - cameras_matrix(alignment, center)
        changes.append(change / ALIGNMENT_STEP @ response.matrix[0])
    variance = np.einsum("aij,ab,bij->ij", changes, alignment.covariance, changes)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def _response_faults(
    response: PlateResponse, unsure: Array, left_out: Set[tuple[int, int]]
) -> list[tuple[str, float, float, str]]:
    """Give name, estimate, standard error and unit of what a response shows.

    ``unsure`` is what the static calibration adds to the standard errors of the matrix, (6, 6).
    """
    value = response.aligned[0] - np.eye(6)
    error = np.hypot(standard_error(response.aligned), unsure)
    faults = []
    for c, true in product(range(len(WRENCH_COMPONENTS)), response.examined):
        if (c, true) not in left_out:
            shown, cause = WRENCH_COMPONENTS[c], WRENCH_COMPONENTS[true]
            name = f"gain of {shown}" if c == true else f"{cause} in {shown}"
            # by the dimensions of what is shown and of what causes it
            unit = {(True, True): "N·m/N", (False, False): "1/m"}.get((c > FZ, true < MX), "1")
            faults.append((name, value[c, true], error[c, true], unit))
    replicates = [
        (f"zero of {name}", response.zero[:, c], "N·m" if c > FZ else "N")
        for c, name in enumerate(WRENCH_COMPONENTS)
    ]
    replicates.append(("drift", response.drift[:, FZ], "N/s"))
    if np.isfinite(response.rise[0, FZ, FZ]):
        replicates.append(("curvature", response.rise[:, FZ, FZ] * response.full_scale_n, "N"))
    replicates.append(("delay in motion", response.delay_s, "s"))
    return faults + [(name, each[0], standard_error(each), unit) for name, each, unit in replicates]
