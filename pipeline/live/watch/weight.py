"""Whether the plates carry the subject, from what they carry over whole strides."""

from typing import Final

import numpy as np

from hbm.notes import Note
from hbm.spatial import GRAVITY_MPS2
from pipeline.live.watch.cycles import LiveCycle
from pipeline.trial.subject import differing_masses

JUDGED: Final = 5
"""Strides of either foot between judgements: some three seconds."""


class WeightWatch:
    """Notes when plates begin to carry another weight than the subject's, and when they stop to.

    Parameters
    ----------
    mass_kg
        Body mass.

    Notes
    -----
    Over a whole stride a body gains no vertical speed, so that the mean vertical force is its
    weight. The median of five strides, on which one step beside a plate has no effect, is compared
    with the body mass as trials compare it (`pipeline.trial.subject.differing_masses`). What two
    such judgements in a row say counts, with the value of the second, in which nothing is left of
    what was before. Strides with frames that do not count are left out.

    Examples
    --------
    >>> watch, empty = WeightWatch(75.0), np.empty(0)
    >>> light = LiveCycle("left", 0.0, 1.1, empty, {}, {}, {}, 1.0, vertical_n=700.0)
    >>> notes = [note for _ in range(20) for note in watch.add(light)]
    >>> [note.code for note in notes], round(notes[0].values["carried_kg"], 1)
    (['live_weight_differs'], 71.4)
    """

    def __init__(self, mass_kg: float) -> None:
        self._mass_kg = mass_kg
        self._carried_kg: list[float] = []
        self._differs = self._latest = False

    def add(self, stride: LiveCycle) -> tuple[Note, ...]:
        """Take a stride; give what it and those before show."""
        if np.isfinite(stride.vertical_n):
            self._carried_kg.append(stride.vertical_n / GRAVITY_MPS2)
        if len(self._carried_kg) < JUDGED:
            return ()
        carried_kg = float(np.median(self._carried_kg))
        self._carried_kg.clear()
        differs = bool(differing_masses({"of the body": self._mass_kg}, carried_kg))
        before, self._latest = self._latest, differs
        if differs != before or differs == self._differs:
            return ()
        self._differs = differs
        masses = {"carried_kg": carried_kg, "mass_kg": self._mass_kg}
        if not self._differs:
            return (Note.of("live_weight_agrees", **masses),)
        difference = carried_kg / self._mass_kg - 1
        return (Note.of("live_weight_differs", **masses, difference=difference),)
