"""Causes of residuals: what may be wrong, how large it usually is, and what it does."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Final

import numpy as np

from hbm.model import Body
from hbm.signals.filtering import Filtered, butterworth
from hbm.spatial import Array, Indices, shift_wrench
from hbm.spelling import packaged_toml
from pipeline.trial.chain import Chain

OF_PERSON: Final = ("inertia", "soft_tissue", "markers", "skin")
"""Groups that are always named together: in simulated trials, of which the truth is known, walking
shows that body or markers are wrong, and takes one for the other (docs/explanation.md)."""

UNSEEN: Final = frozenset({"unseen_trunk", "unseen_arms"})
"""Groups of what moves without markers: markers on it remove them."""
HELD: Final = 1e-3
"""Of the standard deviation of a size that was found elsewhere: so near the residuals leave it."""


@cache
def groups() -> Mapping[str, Mapping[str, str]]:
    """Give the groups of causes, as `groups.toml` lists them; "person" stands for `OF_PERSON`."""
    return packaged_toml("pipeline.explain", "groups.toml")


@dataclass(frozen=True, slots=True)
class Prior:
    """The usual size of a cause.

    Attributes
    ----------
    size
        One standard deviation.
    unit
        Of the size.
    source
        Where the size is from.
    advice
        What a laboratory can do to know it better; empty where nothing simple does.
    mean
        What is expected: zero but where something is known of the trial.
    rare
        Whether it is a fault, which is mostly absent, and larger than usual where it is there.
    usual
        The size as published, where what is known of the trial narrows it.
    harmonics
        Of what changes in the course of the gait cycle: one standard deviation of sine and of
        cosine, 1, 2, … times a cycle, where they are known.
    """

    size: float
    unit: str
    source: str
    advice: str = ""
    mean: float = 0.0
    rare: bool = False
    usual: float = 0.0
    harmonics: Sequence[float] = ()

    def narrowed(self, size: float, mean: float = 0.0) -> "Prior":
        """Give the prior of what was measured: one standard deviation, and what is expected."""
        return replace(self, size=size, mean=mean, rare=False)

    def calibrated(self, error: float) -> "Prior":
        """Give the prior of what a calibration left an error of: at most the usual size."""
        # a calibration without error leaves a tenth of the usual size, since days differ
        return replace(self, size=max(min(self.size, error), 0.1 * self.size))


@cache
def priors() -> dict[str, Prior]:
    """Give the usual sizes by kind of cause, as `priors.toml` lists them.

    Examples
    --------
    >>> priors()["delay"].unit
    's'
    """
    rows = packaged_toml("pipeline.explain", "priors.toml").items()
    return {kind: Prior(**row, usual=row["size"]) for kind, row in rows}


Change = Callable[[Chain, float], Chain]
"""Gives the chain with a cause of a size: as if the recording had that fault besides its own."""

Altered = Callable[[Any, float], Any]
"""Gives a stage of the chain, or a part of it, with a cause of a size."""


def _unaltered(body: Body, size: float) -> Body:
    return body


def change_of(stage: str, altered: Altered) -> Change:
    """Give the change by a cause that alters one stage of the chain by its size."""

    def change(chain: Chain, size: float) -> Chain:
        return chain.changed(**{stage: altered(getattr(chain, stage), size)})

    return change


@dataclass(frozen=True, slots=True, eq=False)
class Cause:
    """Something that may be wrong with a trial, of unknown size.

    Attributes
    ----------
    name
        What it is, in words, such as "plate 1: zero of Fz".
    group
        Causes whose shares are reported together, one of `groups`.
    prior
        How large it usually is.
    change
        What the chain is with it.
    of_platform
        Whether it follows the platform's motion, which does not repeat with the gait cycle.
    found
        Size and one standard deviation of it by a better estimate than that from the residuals,
        which then say nothing of it; None where they do.
    along
        Of a combination of independent errors that all trials share, the part of each, (D,) of
        length one; None for an error of its own.
    in_lab
        What the named component of a plate is in the lab, such as "pitch moment"; empty where it is
        along no axis of the lab, and of other causes.
    moves
        Course, (T, 1), and change of the coordinates per unit of it and of the size, (T, 46), of
        what changes the residual by them and the body alone; None of other causes.
    alters
        Gives the body with such a cause of a size.
    """

    name: str
    group: str
    prior: Prior
    change: Change
    of_platform: bool = False
    found: tuple[float, float] | None = None
    along: Array | None = None
    in_lab: str = ""
    moves: tuple[Array, Array] | None = None
    alters: Altered = _unaltered

    @property
    def within(self) -> str:
        """What has one size of it: a trial, a subject, the laboratory.

        What a calibration leaves is a cause of each trial, as its directions are.
        """
        return groups()[self.group]["within"] if self.along is None else "trial"

    @property
    def expected(self) -> tuple[float, float, float]:
        """Its mean and usual size, and the deviation of a size that was found elsewhere, else 0."""
        if self.found is None:
            return self.prior.mean, self.prior.size, 0.0
        size, deviation = self.found
        return size, HELD * deviation, deviation

    @property
    def is_rare(self) -> bool:
        """Whether it is a fault whose size the residuals are to show."""
        return self.prior.rare and not self.found

    def effect(self, chain: Chain) -> Array:
        """Give the residual that it adds per unit of its size, (T, 6) [N, N·m per unit].

        Central difference over one standard deviation to either side, in lab axes about the pelvis
        origin.
        """
        measured = chain.wrenches  # before it is changed, so that both chains share them
        more, less = self._changed(chain, self.prior.size)
        if more.wrenches is measured:
            difference = more.residual - less.residual
        else:
            # linear in the wrenches: the filter passes the difference once
            apart = chain.changed(wrenches=tuple(map(np.subtract, more.wrenches, less.wrenches)))
            difference = -shift_wrench(apart.on_ground, chain.filtered.value[:, :3])
        return np.asarray(difference / (2 * self.prior.size))

    def _changed(self, chain: Chain, size: float) -> Iterator[Chain]:
        """Give the chain with the cause of a size, and of as much less."""
        if self.moves is None:
            yield from (self.change(chain, end) for end in (size, -size))
            return
        # the filter is linear: one pass of the change serves both ends
        course, moved = self.moves
        columns, settings = np.flatnonzero(moved.any(axis=0)), chain.settings
        # few coordinates are picked; where most move, all are filtered, which takes no copy
        moving: Indices | slice = columns if 2 * len(columns) < moved.shape[1] else slice(None)
        by_filter = chain.time, settings.cutoff_hz, settings.filter
        step = butterworth(course * moved[:, moving], *by_filter)
        for end in (size, -size):
            state = Filtered(*(values.copy() for values in chain.filtered))
            for values, by in zip(state, step, strict=True):
                values[:, moving] += end * by
            yield chain.changed(body=self.alters(chain.body, end), filtered=state)


def corrected(chain: Chain, causes: Sequence[Cause], size: Array) -> Chain:
    """Give the chain without causes of these sizes, (K,); its markers stay as they are."""
    # what moves coordinates alone adds up: the recording is copied for no cause
    added = np.zeros_like(chain.q)
    for cause, amount in zip(causes, size, strict=True):
        if cause.moves is None:
            chain = cause.change(chain, -amount)
        else:
            course, moved = cause.moves
            chain = chain.changed(body=cause.alters(chain.body, -amount))
            added -= amount * course * moved
    return chain.changed(q=chain.q + added)
