"""Which model compensates trials: static, unless a dynamic one is clearly and safely better."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from compensation.inertia.checks import MAX_UNEXPLAINED_N
from compensation.inertia.dynamic import fit_dynamic, left_of_held_out
from compensation.inertia.fit import MIN_SAMPLES_PER_GAIN
from compensation.inertia.model import SLOW_HZ, InertiaModel, Setup
from compensation.inertia.quality import MAX_LEFT_N, MAX_LEFT_NM
from compensation.inputs import read_rate, read_table
from hbm.notes import Note
from hbm.signals.filtering import low_pass
from hbm.spatial import WRENCH_COMPONENTS, Array, read_only

Kind = Literal["static", "dynamic"]
ALLOWED: Final = np.repeat([MAX_LEFT_N, MAX_LEFT_NM], 3)
MAX_SHARE: Final = 0.8
"""Of what the static model leaves, that a dynamic one may leave to be chosen: less is no clear gain
for four times as many numbers."""
MAX_WORSE: Final = 1.1
"""Factor by which it may be worse in any component of any recording."""
STATED: Final = "as stated; by itself the program takes the {model} one ({reason})"
TOO_SHORT: Final = "the recording is too short to judge a dynamic one"
NEGLIGIBLE_SHARE: Final = 0.1
"""Of what residuals allow: whether a component is left less than this does not count."""


@dataclass(frozen=True, slots=True)
class EmptyPlate:
    """Samples of an empty plate, and what the accelerometers felt at each.

    Attributes
    ----------
    name
        Of the plate.
    felt
        Readings and, for a dynamic model, their differences as `dynamic_channels` gives them,
        (N, K) [m/s²].
    wrench
        In the plate's frame, (N, 6) [N, N·m]. Both low-passed alike, NaN where unknown.
    """

    name: str
    felt: Array
    wrench: Array

    @property
    def known(self) -> Array:
        """Of which samples both are known, (N,)."""
        both = np.isfinite(self.felt).all(axis=1) & np.isfinite(self.wrench).all(axis=1)
        return np.asarray(both)


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
        limit = MAX_WORSE * np.maximum(self.static, NEGLIGIBLE_SHARE * ALLOWED)
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
    reason
        In words, from which a sentence about the model continues.
    """

    model: Kind
    reason: str

    def __post_init__(self) -> None:
        if self.model not in get_args(Kind):
            raise ValueError(f"model must be static or dynamic, got {self.model!r}")

    @property
    def note(self) -> Note:
        """The choice as a note."""
        return Note.of("calibration_model", model=self.model, reason=self.reason)


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


def choose(
    recording: str,
    plates: Sequence[EmptyPlate],
    static: Mapping[str, InertiaModel],
    checks: Mapping[str, Sequence[EmptyPlate]] | None = None,
    stated: Literal["auto"] | Kind = "auto",
) -> tuple[Choice, dict[str, InertiaModel]]:
    """Choose the model of a calibration by held-out samples, or take the stated one, and say why.

    Parameters
    ----------
    recording
        Name of the calibration recording.
    plates
        Its samples, with the differences for `LAGS_S`.
    static
        Plate -> the static model that was fitted to them, with a setup.
    checks
        Name -> the samples of another recording, recorded alike; plates on which somebody is are
        left out.
    stated
        A model that is to be taken; "auto" for the better one.

    Returns
    -------
    choice
        As `choose_model`, by six parts of the calibration recording, each held out of the fit to
        the others, and by the other recordings.
    models
        Plate -> its dynamic model; empty where the static ones are chosen.

    Raises
    ------
    ValueError
        A dynamic model is stated of which the recording is too short, or none of another
        recording's plates is empty or known.
    """
    if stated != "dynamic" and any(_is_short(plate) for plate in plates):
        return Choice("static", TOO_SHORT), {}
    dynamic = {}
    for plate in plates:
        setup = _setup(static[plate.name])
        dynamic[plate.name] = fit_dynamic(plate.felt[plate.known], plate.wrench[plate.known], setup)
    own = Comparison.of(
        f"held-out parts of {recording}", [_held_out(plate, static[plate.name]) for plate in plates]
    )
    others = [_on(name, samples, static, dynamic) for name, samples in (checks or {}).items()]
    best = choose_model([own, *others])
    if stated != "auto" and stated != best.model:
        best = Choice(stated, STATED.format(model=best.model, reason=best.reason))
    return best, dynamic if best.model == "dynamic" else {}


def choose_model(comparisons: Sequence[Comparison]) -> Choice:
    """Choose between the static and the dynamic model of a calibration.

    Parameters
    ----------
    comparisons
        Of the calibration's own parts first, then of other recordings.

    Returns
    -------
    Choice
        Dynamic where it leaves at most 0.8 of the calibration's own parts, no more than the static
        one of any other recording, and in none more than 1.1 times as much of any component. Else
        static.

    Raises
    ------
    ValueError
        Nothing to compare.

    Examples
    --------
    >>> left = np.ones((1, 2, 6))
    >>> choose_model([Comparison("empty.c3d", 6 * left, 2 * left)]).model
    'dynamic'
    >>> choose_model([Comparison("empty.c3d", 6 * left, 5.5 * left)]).model
    'static'
    """
    if not comparisons:
        raise ValueError("nothing to compare the models by")
    own, *others = comparisons
    for comparison in comparisons:
        if comparison.worse:
            components = ", ".join(comparison.worse)
            return Choice("static", f"{comparison.in_words()}, clearly more of {components}")
    if own.share > MAX_SHARE:
        return Choice("static", f"{own.in_words()}: no clear gain")
    for comparison in others:
        if comparison.share > 1:
            return Choice("static", f"{comparison.in_words()}: no gain")
    return Choice("dynamic", "; ".join(one.in_words() for one in comparisons))


def _size(left: Array) -> float:
    """Give the RMS of all that passes the calibration's filter, in units of what is allowed."""
    return float(np.sqrt(np.mean((left[:, 0] / ALLOWED) ** 2)))


def _held_out(plate: EmptyPlate, static: InertiaModel) -> tuple[Array, Array]:
    """Give what both models leave of parts of a recording that are held out of their fit."""
    felt, wrench, k = plate.felt[plate.known], plate.wrench[plate.known], 3 * len(static.sensors)
    simple, better = (left_of_held_out(x, wrench, k) for x in (felt[:, :k], felt))
    rate_hz = _setup(static).rate_hz
    return rms_left(simple, rate_hz), rms_left(better, rate_hz)


def _on(
    name: str,
    plates: Sequence[EmptyPlate],
    static: Mapping[str, InertiaModel],
    dynamic: Mapping[str, InertiaModel],
) -> Comparison:
    """Compare both models on another recording, by its plates that are empty."""
    left = []
    for plate in plates:
        if plate.name not in static:
            raise ValueError(f"{name}: the calibration has no {plate.name}")
        felt, wrench, model = plate.felt[plate.known], plate.wrench[plate.known], static[plate.name]
        simple = model.compensate(felt[:, : 3 * len(model.sensors)], wrench)
        if np.linalg.norm(simple[:, :3].std(axis=0)) < MAX_UNEXPLAINED_N:
            better = dynamic[plate.name].compensate(felt, wrench)
            rate_hz = _setup(model).rate_hz
            left.append((rms_left(simple, rate_hz), rms_left(better, rate_hz)))
    if not left:
        raise ValueError(
            f"{name}: none of its plates is empty: the calibration leaves more than "
            f"{MAX_UNEXPLAINED_N:.0f} N of each; record a moving platform with at least one plate "
            "that nobody touches"
        )
    return Comparison.of(name, left)


def _is_short(plate: EmptyPlate) -> bool:
    return bool(plate.known.sum() < MIN_SAMPLES_PER_GAIN * (plate.felt.shape[1] + 1))


def _setup(model: InertiaModel) -> Setup:
    if model.setup is None:
        raise ValueError("the model does not state how it was recorded; fit it with a setup")
    return model.setup
