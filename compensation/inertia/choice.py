"""Which model compensates trials, and how much recordings of people beside weigh in its gains."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from compensation.inertia.dynamic import extend, left_of_held_out
from compensation.inertia.fit import MIN_SAMPLES_PER_GAIN
from compensation.inertia.model import SLOW_HZ, InertiaModel
from compensation.inertia.quality import MAX_LEFT
from compensation.inputs import read_rate, read_table
from hbm.notes import Note
from hbm.signals.filtering import low_pass
from hbm.spatial import WRENCH_COMPONENTS, Array, read_only

Kind = Literal["static", "dynamic"]
Samples = Mapping[str, tuple[Array, Array]]
"""Plate -> what was felt, (N, K) [m/s²], and its wrench, (N, 6) [N, N·m], both without gaps."""
MAX_SHARE: Final = 0.8
"""Of what the static model leaves, that a dynamic one may leave to be chosen: less is no clear gain
for four times as many numbers."""
MAX_SHARE_OF_OTHERS: Final = 0.9
"""The same where recordings were not fitted at all: of other motion they are stronger evidence."""
MAX_WORSE: Final = 1.05
"""Factor by which a dynamic model, or the weight of people beside, may be worse in any component of
a recording's held-out parts: in other motion neither is then clearly worse, more than 1.2 times."""
ALONE: Final = (
    ": clearly less, but of one kind of motion; with --beside or --check, recordings of people "
    "beside an empty plate show whether that is so of others"
)
TOO_SHORT: Final = "the recording is too short to judge a dynamic one"
BESIDE_WEIGHTS: Final = (1.0, 0.1, 0.01, 0.001, 0.0001)
"""Of a sample of people beside an empty plate, by one of commanded motion: alike, down to a
ten-thousandth, at which gains are those of commanded motion wherever it determines them."""
BANDS_HZ: Final = (2.0, SLOW_HZ)
"""Cut-offs below which that weight is judged, besides all that passes the calibration's filter."""
MIN_LEFT: Final = 1e-6
"""Below which nothing is left [N, N·m]."""
NEGLIGIBLE_SHARE: Final = 0.1
"""Of what residuals allow: whether a component is left less than this does not count."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """What both models leave of a recording, or parts of one, to which they were not fitted.

    Attributes
    ----------
    recording
        Its name.
    static, dynamic
        RMS about the mean per plate, of all that passes the calibration's filter and of what passes
        6 Hz, per component, (P, 2, 6) [N, N·m].
    """

    recording: str
    static: Array
    dynamic: Array

    def __post_init__(self) -> None:
        for name in ("static", "dynamic"):
            value = read_only(getattr(self, name))
            if value.ndim != 3 or value.shape[1:] != (2, 6) or not len(value):
                raise ValueError(f"comparison: {name} must be (plates, 2, 6), got {value.shape}")
            object.__setattr__(self, name, value)
        if self.static.shape != self.dynamic.shape:
            raise ValueError("comparison: both models must be judged on the same plates")

    @classmethod
    def of(cls, recording: str, left: Sequence[tuple[Array, Array]]) -> "Comparison":
        """Make one of what both models leave of each plate, as `rms_left` gives it."""
        static, dynamic = zip(*left, strict=True)
        return cls(recording, np.stack(static), np.stack(dynamic))

    @property
    def share(self) -> float:
        """What the dynamic model leaves by what the static one leaves, both by what is allowed."""
        return float(_size(self.dynamic) / max(_size(self.static), np.finfo(float).tiny))

    @property
    def worse(self) -> tuple[str, ...]:
        """Components that the dynamic model leaves clearly more of."""
        limit = MAX_WORSE * np.maximum(self.static, NEGLIGIBLE_SHARE * MAX_LEFT)
        found = np.any(self.dynamic > limit, axis=(0, 1))
        return tuple(c for c, bad in zip(WRENCH_COMPONENTS, found, strict=True) if bad)

    def in_words(self) -> str:
        """Give what both leave as text: force and moment, norms over the components."""
        sizes = [
            np.sqrt(np.mean(np.sum(left[:, 0, part] ** 2, axis=1)))
            for left in (self.dynamic, self.static)
            for part in (slice(3), slice(3, 6))
        ]
        return (
            f"of {self.recording} the dynamic one leaves {sizes[0]:.1f} N and {sizes[1]:.1f} N·m, "
            f"the static one {sizes[2]:.1f} N and {sizes[3]:.1f} N·m"
        )


@dataclass(frozen=True, slots=True)
class Choice:
    """The model that compensates trials, and why.

    Attributes
    ----------
    model
        "static" or "dynamic".
    better
        Which of them the recordings speak for; another one where a model was stated.
    reason
        In words, from which a sentence about the better model continues.
    beside
        How much recordings of people beside weigh in the gains, and why, in words; empty where
        there are none.
    """

    model: Kind
    better: Kind
    reason: str
    beside: str = ""

    def __post_init__(self) -> None:
        for model in (self.model, self.better):
            if model not in get_args(Kind):
                raise ValueError(f"model must be static or dynamic, got {model!r}")

    @property
    def note(self) -> Note:
        """The choice as a note."""
        if self.model == self.better:
            return Note.of("calibration_model", model=self.model, reason=self.reason)
        return Note.of(
            "calibration_model_stated", model=self.model, better=self.better, reason=self.reason
        )


def rms_left(left: ArrayLike, rate_hz: float) -> Array:
    """Give the RMS about the mean of what is left, as a `Comparison` takes it of one plate, (2, 6).

    Parameters
    ----------
    left
        What a model leaves, equal steps, at least a second, (N, 6) [N, N·m].
    rate_hz
        Its sampling rate [Hz].

    Examples
    --------
    >>> slow = np.sin(2 * np.pi * np.arange(0, 10, 0.01))[:, None] * np.ones(6)
    >>> rms_left(3 + slow, 100.0)[:, 0].round(2)
    array([0.71, 0.71])
    """
    error = read_table(left, "left", 6)
    slow = low_pass(error, read_rate(rate_hz), SLOW_HZ, "zero_phase")
    return np.stack([error.std(axis=0), slow.std(axis=0)])


def weigh_beside(
    trials: Sequence[tuple[str, Samples]], readings: int, rate_hz: float
) -> tuple[float, str]:
    """Give the weight of recordings of people beside an empty plate in the gains, and why.

    Parameters
    ----------
    trials
        As for `choose`, the commanded motion first.
    readings
        How many of the channels are readings.
    rate_hz
        Sampling rate of all [Hz].

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
    >>> felt = np.random.default_rng(0).normal([0, 0, 9.81], 1.0, (600, 3))
    >>> rigid = felt, felt @ np.hstack([-150 * np.eye(3), np.full((3, 3), 15.0)])
    >>> weigh_beside([("empty", {"plate 1": rigid})], 3, 100.0)
    (1.0, '')
    """
    if len(trials) == 1:
        return 1.0, ""
    signal, plates = trials[0]
    of_plate = {
        name: [(one[name][0][:, :readings], one[name][1]) for _, one in trials if name in one]
        for name in plates
    }

    def left(samples: Sequence[tuple[Array, Array]], weight: float) -> Array:
        error, *_ = left_of_held_out(samples, readings, weight)
        bands = [low_pass(error, rate_hz, hz, "zero_phase") for hz in BANDS_HZ]
        return np.asarray(np.maximum(np.std([error, *bands], axis=1), MIN_LEFT))

    alone = [left(samples[:1], 1.0) for samples in of_plate.values()]
    before = ""
    for weight in BESIDE_WEIGHTS:
        of_alone = [left(x, weight) / one for x, one in zip(of_plate.values(), alone, strict=True)]
        worse = np.max(of_alone, axis=1)
        if worse.max() <= MAX_WORSE:
            break
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
    stated: Literal["auto"] | Kind = "auto",
    beside_weight: float = 1.0,
) -> tuple[Choice, dict[str, InertiaModel]]:
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
    stated
        A model that is to be taken; "auto" for the better one.
    beside_weight
        With which the static models were fitted.

    Returns
    -------
    choice
        As `choose_model`, by ten parts of each recording, each held out of the fit to all others,
        and by the recordings that are not fitted.
    models
        Plate -> its dynamic model; empty where the static ones are chosen.

    Raises
    ------
    ValueError
        A dynamic model is stated of which the recording is too short.
    """
    if stated != "dynamic" and any(_is_short(felt) for felt, _ in trials[0][1].values()):
        return Choice("static", "static", TOO_SHORT), {}
    of_plate = {
        name: [(k, plates[name]) for k, (_, plates) in enumerate(trials) if name in plates]
        for name in static
    }
    left: list[list[tuple[Array, Array]]] = [[] for _ in trials]
    for name, model in static.items():
        samples, channels = [both for _, both in of_plate[name]], 3 * len(model.sensors)
        readings = [(felt[:, :channels], wrench) for felt, wrench in samples]
        simple, better = (left_of_held_out(x, channels, beside_weight) for x in (readings, samples))
        for (k, _), one, other in zip(of_plate[name], simple, better, strict=True):
            left[k].append((rms_left(one, _rate_hz(model)), rms_left(other, _rate_hz(model))))
    own = [
        Comparison.of(f"held-out parts of {source}", found)
        for (source, _), found in zip(trials, left, strict=True)
    ]
    choice = choose_model(own)
    if stated == "dynamic" or choice.model == "dynamic" or checks:
        dynamic = {
            name: extend(model, [both for _, both in of_plate[name]], beside_weight=beside_weight)
            for name, model in static.items()
        }
        others = [_on(source, plates, static, dynamic) for source, plates in checks]
        choice = choose_model(own, others)
    if stated != "auto":
        choice = replace(choice, model=stated)
    return choice, dynamic if choice.model == "dynamic" else {}


def choose_model(own: Sequence[Comparison], others: Sequence[Comparison] = ()) -> Choice:
    """Choose between the static and the dynamic model of a calibration.

    Parameters
    ----------
    own
        Of held-out parts of the recordings that the models are fitted to.
    others
        Of other recordings.

    Returns
    -------
    Choice
        Static, unless the dynamic model leaves at most 0.8 of what the static one leaves on average
        over the recordings, or 0.9 where some were not fitted at all; no more of any recording;
        and of no component of any recording more than 1.05 times as much. Static too where that
        leaves less than a tenth of what residuals allow, and where there is one recording alone:
        how a model does in other motion is not seen in it.

    Raises
    ------
    ValueError
        Nothing to compare.

    Examples
    --------
    >>> left = np.ones((1, 2, 6))
    >>> signal, people = (Comparison(name, 6 * left, 2 * left) for name in ("empty", "beside"))
    >>> choose_model([signal, people]).model, choose_model([signal]).model
    ('dynamic', 'static')
    """
    comparisons = [*own, *others]
    if not own:
        raise ValueError("nothing to compare the models by")
    for one in comparisons:
        if one.worse:
            return Choice(
                "static", "static", f"{one.in_words()}, clearly more of {', '.join(one.worse)}"
            )
        if one.share > 1:
            return Choice("static", "static", f"{one.in_words()}: no gain")
    reason = "; ".join(one.in_words() for one in comparisons)
    if all(np.all(one.static < NEGLIGIBLE_SHARE * MAX_LEFT) for one in comparisons):
        return Choice("static", "static", f"{reason}: little")
    clear = MAX_SHARE_OF_OTHERS if others else MAX_SHARE
    if np.mean([one.share for one in comparisons]) > clear:
        return Choice("static", "static", f"{reason}: no clear gain")
    if len(comparisons) == 1:
        return Choice("static", "static", f"{reason}{ALONE}")
    return Choice("dynamic", "dynamic", reason)


def _size(left: Array) -> float:
    """Give the RMS of all that passes the calibration's filter, in units of what is allowed."""
    return float(np.sqrt(np.mean((left[:, 0] / MAX_LEFT) ** 2)))


def _on(
    source: str,
    plates: Samples,
    static: Mapping[str, InertiaModel],
    dynamic: Mapping[str, InertiaModel],
) -> Comparison:
    """Compare both models on a recording that was not fitted."""
    left = []
    for name, (felt, wrench) in plates.items():
        model = static[name]
        simple = model.compensate(felt[:, : 3 * len(model.sensors)], wrench)
        better = dynamic[name].compensate(felt, wrench)
        rate_hz = _rate_hz(model)
        left.append((rms_left(simple, rate_hz), rms_left(better, rate_hz)))
    return Comparison.of(source, left)


def _is_short(felt: Array) -> bool:
    return bool(len(felt) < MIN_SAMPLES_PER_GAIN * (felt.shape[1] + 1))


def _rate_hz(model: InertiaModel) -> float:
    if model.setup is None:
        raise ValueError("the model does not state how it was recorded; fit it with a setup")
    return model.setup.rate_hz
