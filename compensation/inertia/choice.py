"""Which model compensates trials, and how much recordings of people beside weigh in its gains."""

from collections.abc import Mapping, Sequence
from typing import Final, Literal

import numpy as np

from compensation.inertia.fit import LAGS_S, fit_trials, is_short, left_of_held_out
from compensation.inertia.model import InertiaModel, Setup
from compensation.inertia.model_error import SLOW_HZ, thinning_step
from compensation.inertia.quality import MAX_LEFT
from hbm.numbers import read_numbers
from hbm.signals.filtering import low_pass
from hbm.spatial import WRENCH_COMPONENTS, Array

LIMITS: Final = read_numbers("compensation", "thresholds.toml", "choice")

Samples = Mapping[str, tuple[Array, Array]]
"""Plate -> accelerations, (N, K) [m/s²], and its wrench, (N, 6) [N, N·m], both without gaps."""
BESIDE_WEIGHTS: Final = (1.0, 0.1, 0.01, 0.001, 0.0001)
"""Of a sample of people beside an empty plate, by one of commanded motion: alike, down to a
ten-thousandth, at which gains are those of commanded motion wherever it determines them."""


def weigh_beside(trials: Sequence[tuple[str, Samples]], setup: Setup) -> tuple[float, str]:
    """Give the weight of recordings of people beside an empty plate in the gains, and why.

    Parameters
    ----------
    trials
        As for `choose`, the commanded motion first.
    setup
        How all were recorded.

    Returns
    -------
    weight
        The largest of `BESIDE_WEIGHTS` with which no component of any plate is worse in held-out
        parts of the commanded motion than without these recordings, in any band; else the smallest.
    reason
        In words; empty where there is nothing to weigh.

    Notes
    -----
    What the platform's commanded motion shows is what the model is for. What people add is error,
    unless the accelerometers show it: then it can be fitted without a loss.

    Examples
    --------
    >>> accelerations = np.random.default_rng(0).normal([0, 0, 9.81], 1.0, (600, 3))
    >>> rigid = accelerations, accelerations @ np.hstack([-150 * np.eye(3), np.full((3, 3), 15.0)])
    >>> weigh_beside([("empty", {"plate 1": rigid})], Setup(("rear",), 100.0, None))
    (1.0, '')
    """
    if len(trials) == 1:
        return 1.0, ""
    # as few samples as hold the signal judge alike, in a tenth of the time
    trials, rate_hz = _thinned(trials, setup)
    (signal, plates), k = trials[0], 3 * len(setup.sensors)
    of_plate = {
        name: [(one[name][0][:, :k], one[name][1]) for _, one in trials if name in one]
        for name in plates
    }

    def left(samples: Sequence[tuple[Array, Array]], weight: float) -> Array:
        # by parts to which the fit did not look, in all that is fitted and in slow bands
        error, *_ = left_of_held_out(samples, beside_weight=weight)
        bands = [low_pass(error, rate_hz, hz, "zero_phase") for hz in (2.0, SLOW_HZ)]
        # below 1e-6 N nothing is left
        return np.asarray(np.maximum(np.std([error, *bands], axis=1), 1e-6))

    # measure: what commanded motion alone leaves of its own held-out parts
    alone = [left(samples[:1], 1.0) for samples in of_plate.values()]
    before = ""
    for weight in BESIDE_WEIGHTS:
        of_alone = [left(x, weight) / one for x, one in zip(of_plate.values(), alone, strict=True)]
        worse = np.max(of_alone, axis=1)
        if worse.max() <= LIMITS.worse:
            break
        # the largest weight that no component is clearly worse by
        plate, component = np.unravel_index(worse.argmax(), worse.shape)
        before = (
            f"; with {weight:g}, {WRENCH_COMPONENTS[component]} of {list(plates)[plate]} left of "
            f"held-out parts of {signal} would be {worse.max():.2f} times as large"
        )
    return weight, f"weight {weight:g} per sample in the gains ({signal}: 1){before}"


def choose(
    trials: Sequence[tuple[str, Samples]],
    static: Mapping[str, InertiaModel],
    checks: Sequence[tuple[str, Samples]] = (),
    wanted: Literal["auto", "static", "dynamic"] = "auto",
    beside_weight: float = 1.0,
) -> tuple[str, dict[str, InertiaModel]]:
    """Choose the model of a calibration by held-out samples, or take the stated one, and say why.

    Parameters
    ----------
    trials
        Names of recordings, and the samples of their empty plates, with the differences for
        `LAGS_S`: what the models are fitted to. The first one has all plates.
    static
        Plate -> the static model that was fitted to them, with a setup.
    checks
        The same of recordings that are not fitted.
    wanted
        A model that is to be taken; "auto" for the better one.
    beside_weight
        With which the static models were fitted.

    Returns
    -------
    reason
        In words.
    models
        Plate -> its dynamic model; empty where the static ones are chosen: unless the dynamic model
        leaves at most 0.8 of what the static one leaves, on average over the recordings (ten parts
        of each, held out of the fit to all others, and the recordings that are not fitted), and of
        no component of any recording more than 1.05 times as much. Static too where there is one
        recording alone: how a model does in other motion is not seen in it.

    Raises
    ------
    ValueError
        A dynamic model is stated of which the recording is too short.
    """
    setup = next(iter(static.values())).setup
    assert setup is not None
    if wanted != "dynamic" and any(is_short(channels) for channels, _ in trials[0][1].values()):
        return "static model: the recording is too short to judge a dynamic one", {}
    k, files = 3 * len(setup.sensors), [file for file, _ in (*trials, *checks)]
    judged, rate_hz = _thinned(trials, setup)
    remains: list[list[Array]] = [[] for _ in files]

    def add(recording: int, *pair: Array) -> None:
        """Add what both models leave of a plate: RMS about the mean, of all and below 6 Hz."""
        slow = [low_pass(one, rate_hz, SLOW_HZ, "zero_phase") for one in pair]
        remains[recording].append(np.stack([np.std(band, axis=1) for band in (pair, slow)], axis=1))

    for name in static:
        samples = [(n, *one[name]) for n, (_, one) in enumerate(judged) if name in one]
        both = [(channels, wrench) for _, channels, wrench in samples]
        readings = [(channels[:, :k], wrench) for channels, wrench in both]
        # static and dynamic model, fitted without each part in turn
        simple = left_of_held_out(readings, beside_weight=beside_weight)
        better = left_of_held_out(both, len(LAGS_S), beside_weight)
        for (recording, *_), *pair in zip(samples, simple, better, strict=True):
            add(recording, *pair)
    dynamic: dict[str, InertiaModel] = {}
    if wanted == "dynamic" or checks or _judged(remains, files)[0]:
        for name, model in static.items():
            error = model.model_error
            dynamic[name] = fit_trials(
                [one[name] for _, one in trials if name in one],
                setup,
                belts_mps=() if error is None else error.belts_mps,
                beside_weight=beside_weight,
                lags_s=LAGS_S,
            )
    # recordings that no fit knows are judged as they are
    for recording, (_, plates) in enumerate(_thinned(checks, setup)[0], len(trials)):
        for name, (channels, wrench) in plates.items():
            simple_left = static[name].compensate(channels[:, :k], wrench)
            add(recording, simple_left, dynamic[name].compensate(channels, wrench))
    clear, reason = _judged(remains, files)
    kind = wanted if wanted != "auto" else "dynamic" if clear else "static"
    as_stated = "" if wanted == "auto" else ", as given"
    return f"{kind} model{as_stated}: {reason}", dynamic if kind == "dynamic" else {}


def _thinned(
    trials: Sequence[tuple[str, Samples]], setup: Setup
) -> tuple[list[tuple[str, Samples]], float]:
    """Give as few samples as hold all of what was low-passed, and their rate [Hz]."""
    step = thinning_step(setup.rate_hz, setup.cutoff_hz)
    thinned: list[tuple[str, Samples]] = [
        (
            file,
            {name: (channels[::step], wrench[::step]) for name, (channels, wrench) in one.items()},
        )
        for file, one in trials
    ]
    return thinned, setup.rate_hz / step


def _judged(remains: Sequence[Sequence[Array]], files: Sequence[str]) -> tuple[bool, str]:
    """Whether the dynamic model is better, clearly and in motion of several kinds; in words too.

    From what static and dynamic model leave of each plate of each recording, (2, 2, 6): of all and
    below 6 Hz.
    """
    fractions, worse = [], list[str]()
    for file, plates in zip(files, remains, strict=True):
        if not plates:
            continue
        sizes = np.array(plates)
        # RMS over components and plates, each by its limit
        of_static, of_dynamic = np.sqrt(np.mean((sizes[:, :, 0] / MAX_LEFT) ** 2, axis=(0, 2)))
        fractions.append(of_dynamic / max(of_static, np.finfo(float).tiny))
        # what is far below its limit may be worse
        limit = LIMITS.worse * np.maximum(sizes[:, 0], LIMITS.negligible * MAX_LEFT)
        more = np.any(sizes[:, 1] > limit, axis=(0, 1))
        worse += [f"{WRENCH_COMPONENTS[c]} of {file}" for c in np.flatnonzero(more)]
    fraction = float(np.mean(fractions))
    reason = f"of what was not fitted, the dynamic one leaves {fraction:.2f} of the static one's"
    if worse:
        return False, f"{reason}, but more of {', '.join(worse)}"
    if fraction <= LIMITS.largest_fraction and len(fractions) == 1:
        reason += (
            ", but in one kind of motion; recordings of people beside an empty plate (--beside, "
            "--check) show others"
        )
    return fraction <= LIMITS.largest_fraction and len(fractions) > 1, reason
