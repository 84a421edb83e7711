"""The modes of a structure: independent systems of first order, solved exactly in time."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from hbm.spatial import Array
from pipeline.virtual_lab.machine.structure import COORDINATES, Structure, state_matrix

Complex = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class Modes:
    """Complex modes ``ż = λ z + b u`` of which a structure's motion is the sum.

    Attributes
    ----------
    shapes
        State of the structure by mode, of each conjugate pair one, (42, 21).
    by_inputs
        What excites the modes, (21, inputs).
    decay, now, before
        The modes at the next sample: ``decay * z`` and the weights of what excites them at that
        sample and at this one, (21,) each.
    at_rest
        The modes under a constant excitation, by this, (21,).
    """

    shapes: Complex
    by_inputs: Complex
    decay: Complex
    now: Complex
    before: Complex
    at_rest: Complex

    @classmethod
    def of(cls, structure: Structure, load_of_inputs: Array, rate_hz: float) -> "Modes":
        """Find the modes of a structure, excited by inputs that are linear between samples."""
        values, vectors = np.linalg.eig(state_matrix(structure))
        accelerating = np.zeros((2 * COORDINATES, load_of_inputs.shape[1]))
        accelerating[COORDINATES:] = np.linalg.solve(structure.mass, load_of_inputs)
        excited = np.linalg.solve(vectors, accelerating.astype(complex))
        one = values.imag > 0
        if np.count_nonzero(one) != COORDINATES:
            raise ValueError(
                f"the structure vibrates in {np.count_nonzero(one)} modes, expected {COORDINATES}; "
                "lower assembly_kg or flexibility"
            )
        value = values[one].astype(complex)
        x = np.asarray(value / rate_hz, complex)
        grown: Complex = np.exp(x)
        now: Complex = (grown - 1 - x) / x**2 / rate_hz
        before: Complex = (grown - 1) / x / rate_hz - now
        return cls(
            vectors[:, one], excited[one], grown, now, before, np.asarray(-1 / value, complex)
        )

    def readout(self, output: Array) -> Array:
        """Give the matrix from real and imaginary parts of the modes to outputs of the state."""
        by_mode = 2 * output @ self.shapes
        return np.hstack([by_mode.real, -by_mode.imag])

    def advance(self, inputs: Array, state: Complex | None) -> tuple[Array, Complex]:
        """Give real and imaginary parts of the modes, (42, n), and the state of their filters."""
        parts = np.vstack([self.by_inputs.real, self.by_inputs.imag]) @ inputs
        modes = len(self.decay)
        if state is None:
            first = parts[:modes, 0] + 1j * parts[modes:, 0]
            state = (self.at_rest - self.now) * first
        after = np.empty_like(state)
        for k, (decay, now, before) in enumerate(
            zip(self.decay, self.now, self.before, strict=True)
        ):
            exciting = parts[k] + 1j * parts[modes + k]
            moved, after[k : k + 1] = lfilter(
                [now, before], [1, -decay], exciting, zi=state[k : k + 1]
            )
            parts[k], parts[modes + k] = moved.real, moved.imag
        return parts, after
