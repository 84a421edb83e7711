"""Markers attached to a skeleton: their sums for the kernels, their distances from the model."""

from dataclasses import dataclass

import numpy as np

from hbm.coordinates import MOVING
from hbm.kernels.kernel import Kernels
from hbm.kernels.skeleton import N_SUMS
from hbm.spatial import Array, Indices


@dataclass(frozen=True, slots=True)
class MarkerAttachment:
    """Markers attached to a skeleton, and where they were measured.

    Attributes
    ----------
    segment
        Number of the segment that each marker is attached to, (K,).
    local
        Position of each marker in its segment, (K, 3) [m].
    weight
        Of each marker in the sum of squares, (K,).
    geometry
        The body's offsets and hinge axes, as the kernels take them.
    position
        Measured markers of the whole trial in the lab, (T, M, 3) [m]; NaN where missing.
    column
        Column of each marker among the measured ones, (K,).
    """

    segment: Indices
    local: Array
    weight: Array
    geometry: Array
    position: Array
    column: Indices

    def __post_init__(self) -> None:
        for name in ("segment", "column"):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), np.int64))
        for name in ("local", "weight", "geometry", "position"):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), float))

    def measured(self, rows: Indices) -> Array:
        """Give the markers in some frames of the trial, (F, K, 3) [m]."""
        return self.position[rows[:, None], self.column]

    def sums(self, position: Array) -> Array:
        """Sum markers at given positions, (F, K, 3), per segment (`N_SUMS`), (F, 23 · segments)."""
        seen = np.isfinite(position[..., 0])
        measured, weight = np.where(seen[..., None], position, 0.0), seen * self.weight
        p = self.local
        products = [p[:, i] * p[:, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
        local_terms = np.column_stack([np.ones(len(p)), p, *products])
        measured_factors = np.column_stack([np.ones(len(p)), p])
        sums = np.zeros((len(position), len(MOVING), N_SUMS))
        for s in np.unique(self.segment):
            own = np.flatnonzero(self.segment == s)
            w, m = weight[:, own], measured[:, own]
            weighted = w[..., None] * m
            sums[:, s, :10] = w @ local_terms[own]
            crossed = np.einsum("tki,ka->tai", weighted, measured_factors[own])
            sums[:, s, 10:22] = crossed.reshape(-1, 12)
            sums[:, s, 22] = np.einsum("tki,tki->t", weighted, m)
        return sums.reshape(len(position), N_SUMS * len(MOVING))

    def errors(self, kernels: Kernels, position: Array, q: Array, jobs: int) -> Array:
        """Give the distance of given positions, (F, K, 3), from the model, (F, K) [m]."""
        poses = kernels.segment_poses(q, self.geometry, jobs=jobs)[0]
        poses = poses.reshape(len(q), len(MOVING), 4, 3)
        local = np.column_stack([self.local, np.ones(len(self.local))])
        model = np.einsum("tkai,ka->tki", poses[:, self.segment], local)
        return np.asarray(np.linalg.norm(model - position, axis=-1))
