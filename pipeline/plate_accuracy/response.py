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
from hbm.numbers import read_numbers
from hbm.spatial import GRAVITY_MPS2, WRENCH_COMPONENTS, Array, Mask, shift_wrench
from pipeline.config.plate_study import BeltSide, PlatesFile
from pipeline.plate_accuracy.trials import WeightTrial, to_cameras

FX, FY, FZ, MX, MY, MZ = range(6)
LIMITS: Final = read_numbers("pipeline.plate_accuracy", "thresholds.toml", "response")
STANCE: Final = read_numbers("pipeline.plate_accuracy", "thresholds.toml", "stance")
VIBRATION: Final = read_numbers("pipeline.plate_accuracy", "thresholds.toml", "vibration")
EXCITED: Final = (FX, FZ, MX, MY, MZ)
"""Components that a weight on a belt excites; no lateral force acts on it."""


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
        # rises that are not known, of fewer than three masses, are taken as none
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
    # the first is of all recordings, about which those without one are as far as errors allow
    count = len(replicates) - 1
    off = replicates[1:] - replicates[0]
    return np.asarray(np.sqrt((count - 1) / count * np.sum(off**2, axis=0)))


_Splines = Sequence[CubicSpline]
"""What plates measured, slowly, through all samples of each recording."""


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
    # Mx and Mz need levers across the belt, Fx and Mz a force along it, Fz several weights
    excited = tuple(
        c
        for c in EXCITED
        if (positions or c not in (MX, MZ))
        and (changing or c not in (FX, MZ))
        and (masses > 1 or c != FZ)
    )
    model = _Model(excited, (FZ,) if masses >= LIMITS.fewest_masses else (), file.full_scale_n)
    if len(trials) <= model.coefficients:
        return None
    splines = [CubicSpline(trial.time, trial.slow_measured) for trial in trials]
    model = replace(model, rising=(*model.rising, *_rising(trials, splines, model)))
    coefficients, delay_s = _fit(trials, splines, model)
    # what is reported less the truth was regressed: the identity is the truth
    aligned = np.tile(np.eye(6), (len(coefficients), 1, 1))
    aligned[:, :, excited] += coefficients[:, 2 : model.delay].swapaxes(1, 2)
    in_use, rise = aligned.copy(), np.full_like(aligned, 0.0 if model.rising else np.nan)
    rise[:, :, model.rising] = coefficients[:, model.delay + 1 :].swapaxes(1, 2)
    if not file.height_stated:
        in_use[:, MY, FX] = rise[:, MY, FX] = 0
    # from the cameras' frame back to what the plate itself reports
    as_read = np.linalg.inv(cameras_matrix(alignment, trials[0].center))
    return PlateResponse(
        matrix=as_read @ in_use,
        aligned=aligned,
        zero=coefficients[:, 0] @ as_read.T,
        drift=coefficients[:, 1] @ as_read.T,
        rise=as_read @ rise,
        delay_s=delay_s,
        scatter=_scatter(trials, coefficients, model, float(delay_s[0])),
        examined=excited,
        degrees_of_freedom=len(trials) - model.coefficients,
        full_scale_n=file.full_scale_n,
    )


def cameras_matrix(alignment: PlateAlignment, center: Array) -> Array:
    """Give the matrix that brings a plate's wrench about its centre to the cameras' frame."""
    # columns: what becomes of each unit wrench, moved to the lab origin and back
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
        # a small delay adds minus the rate of change; that of My, the largest moment, shows it best
        constant, rate = np.ones(len(time)), -np.gradient(truth[:, MY], time)
        return np.column_stack([constant, time - time[0], truth[:, self.excited], rate, risen])


def _rising(trials: Sequence[WeightTrial], splines: _Splines, model: _Model) -> tuple[int, ...]:
    """Find the components, one by one, of which a gain rises or falls significantly with the load.

    Gains of which no rise shows are taken as constant: a rise in vain would cost precision.
    """
    others = [c for c in model.excited if model.rising and c not in model.rising]
    freedom = len(trials) - model.coefficients - 1
    rising = []
    for c in others if freedom > 0 else ():
        rises = _fit(trials, splines, replace(model, rising=(*model.rising, c)))[0][:, -1]
        # Bonferroni over all components that could rise and all in which that would show
        critical = stats.t.isf(ALPHA / 2 / (len(others) * rises.shape[1]), freedom)
        if np.any(np.abs(rises[0]) > critical * standard_error(rises)):
            rising.append(c)
    return tuple(rising[:freedom])


def _fit(trials: Sequence[WeightTrial], splines: _Splines, model: _Model) -> tuple[Array, Array]:
    """Give the coefficients of all components, (K, coefficients, 6), and the delay, (K,)."""
    x = [model.regressors(trial)[_inside(trial)] for trial in trials]
    # normal equations of columns of equal size, or units would decide what counts as singular
    size = np.sqrt(np.mean(np.vstack(x) ** 2, axis=0))
    size[size == 0] = 1
    x = [columns / size for columns in x]
    inverse = np.linalg.pinv(_all_and_without_each(x, x), hermitian=True)
    delay_s = np.zeros(len(trials) + 1)
    # Newton's method: linear in the delay but for what it does to other terms, so that two steps do
    for _ in range(2):
        # the plate reads later what was true now: it is read at the time plus the delay
        errors = [
            (measured(trial.time + delay_s[0]) - trial.slow_truth)[_inside(trial)]
            for trial, measured in zip(trials, splines, strict=True)
        ]
        coefficients = inverse @ _all_and_without_each(x, errors) / size[:, None]
        gain = 1 + coefficients[:, 2 + model.excited.index(MY), MY]
        delay_s = delay_s[0] + coefficients[:, model.delay, MY] / gain
    return coefficients, delay_s


def _all_and_without_each(x: Sequence[Array], y: Sequence[Array]) -> Array:
    """Give sums of products over all recordings, then without each in turn, (K, …)."""
    of_each = np.array([columns.T @ values for columns, values in zip(x, y, strict=True)])
    # what one recording adds is subtracted
    return np.concatenate([of_each.sum(0)[None], of_each.sum(0) - of_each])


def _inside(trial: WeightTrial, edge_s: float = 1.0) -> Mask:
    # filters at 2.4 Hz are inaccurate in the first and the last second
    first, last = trial.time[0] + edge_s, trial.time[-1] - edge_s
    return np.asarray((trial.time > first) & (trial.time < last))


def _scatter(
    trials: Sequence[WeightTrial], coefficients: Array, model: _Model, delay_s: float
) -> Array:
    """Give the variance about the response that every load has, and that growing with it.

    Where enough weights move in sines, only those count: low-passed at 2.4 Hz, the truth of others
    lacks much of what happens where the belt turns back.
    """
    sines = np.array([trial.weight.profile == "sine" for trial in trials])
    counted = sines if sines.sum() >= LIMITS.fewest_sines else np.ones(len(trials), bool)
    variance, load = [], []
    for trial in trials:
        chosen = trial.used & _inside(trial)
        chosen = chosen if chosen.any() else trial.used
        # the delay is applied by a shift in time instead of its linear term
        x = model.regressors(trial)
        x[:, model.delay] = 0
        predicted = trial.slow_truth + x @ coefficients[0]
        late = CubicSpline(trial.time, predicted)(trial.time - delay_s)
        rest = shift_wrench(trial.measured, trial.center) - late
        square = np.mean(rest[chosen] ** 2, axis=0)
        # a hundredth stays where the marker's noise explains more than all; a dead channel has none
        variance.append(np.maximum(square - trial.slow_noise**2, np.maximum(0.01 * square, 1e-12)))
        load.append(np.mean(trial.slow_truth[chosen, FZ]))
    spread, basis = np.array(variance), np.column_stack([np.ones(len(load)), np.square(load)])

    def fitted(rows: Mask) -> list[Array]:
        # relative errors: a variance is as uncertain as it is large
        ones = np.ones(np.count_nonzero(rows))
        return [np.linalg.lstsq(basis[rows] / v[rows, None], ones)[0] for v in spread.T]

    without_one = counted & ~np.eye(len(trials), dtype=bool)
    return np.array([np.column_stack(fitted(rows)) for rows in (counted, *without_one)])


QUANTITIES: Final = ("Fx", "Fy", "Fz", "COPx", "COPy", "Mx", "My", "Mz")


def stance_loads(body_mass_kg: float) -> Array:
    """Give wrenches of one foot about the centre of a plate's surface, (L, 6) [N, N·m].

    Examples
    --------
    >>> stance_loads(75.0).shape
    (54, 6)
    """
    weight = body_mass_kg * GRAVITY_MPS2
    # every phase of stance with every lateral force at every place
    cases = list(product(STANCE.phases, STANCE.lateral, STANCE.along, STANCE.across))
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
    nodes_s = STANCE.duration / 2 * (1 + np.array([-1.0, 1.0]) / np.sqrt(3.0))
    loads = np.repeat(loads, len(nodes_s), axis=0)
    times = np.resize(nodes_s, len(loads))
    reported = response.report(loads) + times[:, None] * response.drift[:, None]
    variance = response.scatter[:, 0, None] + response.scatter[:, 1, None] * loads[:, FZ, None] ** 2
    if calibration is not None:
        reported = calibration.correct(reported)
        # scatter of components is taken as independent: variances add by squared coefficients
        variance = variance @ (calibration.matrix**2).T
    variance = np.maximum(variance, 0)
    # k replicates, l loads, q quantities, c components
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
    height = STANCE.center_of_mass
    effect[..., range(3), range(3)] = 1
    # the centre of pressure is -My/Fz and Mx/Fz: exact, by the reported load
    effect[..., 3, MY], effect[..., 3, FZ] = -1 / reported[..., FZ], -x / reported[..., FZ]
    effect[..., 4, MX], effect[..., 4, FZ] = 1 / reported[..., FZ], -y / reported[..., FZ]
    # moments about the centre of mass above the foot: M - c × F with c = (x, y, height)
    effect[..., 5, MX], effect[..., 5, FZ], effect[..., 5, FY] = 1, -y, height
    effect[..., 6, MY], effect[..., 6, FZ], effect[..., 6, FX] = 1, x, -height
    effect[..., 7, MZ], effect[..., 7, FX], effect[..., 7, FY] = 1, y, -x
    return effect


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
    # steps of a fifth of the width that a line has in 4 s
    hz = np.arange(VIBRATION.lowest, VIBRATION.highest, 0.05)
    power = np.mean([_power(time, value, hz) for time, value, _ in paths], axis=0)
    if not np.isfinite(power).all():
        return None
    # noise at a frequency: the median over 2 Hz on either side
    floor = np.array([np.median(power[max(k - 40, 0) : k + 41]) for k in range(len(hz))])
    # power of noise, the mean of recordings, is chi-square with two degrees of freedom each
    freedom = 2 * len(trials)
    chance = stats.chi2.isf(VIBRATION.chance / len(hz), freedom) / stats.chi2.median(freedom)
    peak = int(np.argmax(power / floor))
    if power[peak] < chance * floor[peak]:
        return None
    # each recording's peak near the common one, in steps below any uncertainty of a frequency
    near = np.arange(hz[peak] - VIBRATION.near, hz[peak] + VIBRATION.near, 0.002)
    peaks_hz = np.array([near[np.argmax(_power(time, value, near))] for time, value, _ in paths])
    if peaks_hz.std(ddof=1) > VIBRATION.largest_spread:
        return None
    middle = float(np.mean(peaks_hz))
    amplitudes = []
    for time, value, motion in paths:
        # together with the motion, which may have a part at this frequency
        angle = 2 * np.pi * middle * time
        waves = np.column_stack([np.cos(angle), np.sin(angle), motion])
        amplitudes.append(np.hypot(*np.linalg.lstsq(waves, value)[0][:2]))
    error = np.std(amplitudes, ddof=1) / np.sqrt(len(trials))
    return float(np.mean(amplitudes)), float(error), middle


def _beyond_motion(trial: WeightTrial) -> tuple[Array, Array, Array]:
    """Give times, the centre of pressure minus its regression on the motion, and the motion."""
    inside = _inside(trial, 0.5)  # filters of these signals are faster
    load = LIMITS.loaded * float(np.median(trial.truth[:, 2]))
    measured, true = (center_of_pressure(w, load)[:, 0] for w in (trial.measured, trial.truth))
    x = trial.slow_marker[:, 0]  # noise of a faster marker would bias the regression
    v = np.gradient(x, trial.time)
    motion = np.column_stack([np.ones(len(x)), trial.time, x, v, np.gradient(v, trial.time)])
    motion = motion[inside]
    value = (measured - true)[inside]
    return trial.time[inside], value - motion @ np.linalg.lstsq(motion, value)[0], motion


def _power(time: Array, signal: Array, hz: Array) -> Array:
    """Squared amplitude of the sine of every frequency, equally spaced, in a signal."""
    # a chirp z-transform, which gives frequencies as close to each other as is asked for
    turn = 2j * np.pi * (time[1] - time[0])
    spectrum = czt(signal, len(hz), np.exp(-turn * (hz[1] - hz[0])), np.exp(turn * hz[0]))
    return np.asarray(np.abs(2 / len(signal) * spectrum) ** 2)


LEFT_OUT: Final = {(MX, FZ), (MY, FZ), (MX, MY), (MY, MX)}
"""Cross-talk that a rotated or shifted plate causes too: it counts as that, and in total errors."""
OF_HEIGHT: Final = (MY, FX)
"""Cross-talk that a misstated height of the weights causes too."""
ALPHA: Final = 0.05
"""Level of significance of all faults of all plates together."""


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
    faults = []
    for belt, name, value, error, unit, freedom in estimates:
        critical = stats.t.isf(ALPHA / 2 / len(estimates), freedom)
        beyond = bool(abs(value) > critical * error)
        faults.append(FaultEstimate(belt, name, float(value), float(error), unit, freedom, beyond))
    for belt, (supports, words) in product(centers, ((True, "with"), (False, "without"))):
        alike = [t for t in trials if (t.weight.belt, t.weight.supports) == (belt, supports)]
        line = find_vibration(alike)
        if line is not None:
            name, freedom = f"vibration {words} supports", len(alike) - 1
            faults.append(FaultEstimate(belt, name, *line[:2], "m", freedom, True, line[2]))
    return tuple(faults)


def _errors_of_alignment(
    response: PlateResponse, alignment: PlateAlignment, center: Array
) -> Array:
    """Give what the uncertainty of the static calibration adds to that of the matrix, (6, 6)."""
    changes, size = [], 1e-6
    # derivatives of the matrix by angle [rad] and offset [m]
    for step in size * np.eye(3):
        turned = replace(alignment, angle=alignment.angle + step[0])
        moved = replace(turned, offset=alignment.offset + step[1:])
        change = cameras_matrix(moved, center) - cameras_matrix(alignment, center)
        changes.append(change / size @ response.matrix[0])
    # errors propagate by J C J'
    variance = np.einsum("aij,ab,bij->ij", changes, alignment.covariance, changes)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def _response_faults(
    response: PlateResponse, unsure: Array, left_out: Set[tuple[int, int]]
) -> list[tuple[str, float, float, str]]:
    """Give name, estimate, standard error and unit of what a response shows.

    ``unsure`` is what the static calibration adds to the standard errors of the matrix, (6, 6).
    """
    # a perfect plate reports the truth: gains of 1 on the diagonal, no cross-talk beside it
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
    return faults + [(name, k[0], standard_error(k), unit) for name, k, unit in replicates]
