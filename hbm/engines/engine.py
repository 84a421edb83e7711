"""The two engines of inverse dynamics, Pinocchio and the package's own kernels: which one runs.

Where both can be imported, each checks the other on some frames.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from typing import TYPE_CHECKING, Final, Literal, get_args

import numpy as np

from hbm.coordinates import COORDINATES, LAST_Q, N_Q, TREE, support
from hbm.notes import Note
from hbm.spatial import WRENCH_COMPONENTS, Array, Indices, Mask, shift_wrench

if TYPE_CHECKING:
    from hbm.model import Body

EngineName = Literal["pinocchio", "kernels"]
ENGINES: Final[tuple[EngineName, ...]] = get_args(EngineName)
"""Both engines, the default first."""


FreeDynamics = tuple[Array, Array, Mapping[str, Array]]
"""What a motion needs where nothing but gravity acts on the body.

Generalized forces of the 46 coordinates, (T, 46) [N and N·m]; the wrench needed at the pelvis,
(T, 6), lab axes, about mid-hip; segment -> its motion per unit rate of each of the C coordinates
that carry it, in the order of `hbm.coordinates.support`, (T, C, 6): velocity of the point at the
lab origin, angular velocity, lab axes. The product with a wrench on the segment about the lab
origin is the wrench's generalized forces."""


@dataclass(frozen=True, slots=True)
class Engine:
    """An implementation of the equations of motion.

    Attributes
    ----------
    name, version
        Which, and the version of the library that it runs on.
    free_dynamics
        ``(body, q, v, a, segments, jobs)`` -> `FreeDynamics` with the Jacobians of the segments.
    """

    name: EngineName
    version: str
    free_dynamics: Callable[["Body", Array, Array, Array, Collection[str], int], FreeDynamics]


@dataclass(frozen=True, slots=True)
class EngineUsed:
    """Which engine computed a result, and how well the other one agrees.

    Attributes
    ----------
    name, version
        The engine, and the version of the library that it runs on.
    other, other_version
        The engine that checked it; None where it is not installed or no frame is defined.
    frames
        Number of frames that were checked.
    difference
        Largest difference in them, as a share of the frame's largest force or moment; 0 where
        nothing was checked.
    """

    name: EngineName
    version: str
    other: EngineName | None = None
    other_version: str = ""
    frames: int = 0
    difference: float = 0.0

    def __str__(self) -> str:
        return title(self.name, self.version)

    @property
    def note(self) -> Note:
        """What a trial's result says about it."""
        check = "not checked by a second engine: there is none, or no frame to check"
        if self.other is not None:
            other = title(self.other, self.other_version)
            share = f"{self.difference:.0e} of the largest force and moment"
            check = f"checked by {other} in {self.frames} frames, which agrees to {share}"
        return Note.of("engine", engine=str(self), check=check)


def title(name: EngineName, version: str) -> str:
    """Give an engine and its version as they are written in texts."""
    return f"Pinocchio {version}" if name == "pinocchio" else f"kernels ({version})"


def choose_engine(stated: EngineName | None = None) -> Engine:
    """Give the engine to run.

    By default Pinocchio where it can be imported, else the kernels; a ValueError where there is no
    such engine, or it cannot be imported.
    """
    if stated is not None and stated not in ENGINES:
        raise ValueError(f"engine must be one of {', '.join(ENGINES)}, got {stated!r}")
    engine = _available(stated)
    if engine is not None:
        return engine
    raise ValueError(
        'engine = "pinocchio" is set, but Pinocchio cannot be imported here; install it (pip '
        'install pin), omit engine, or set engine = "kernels"'
    )


def other_engine(engine: Engine) -> Engine | None:
    """Give the engine that can check another one; None where it cannot be imported."""
    return _kernels() if engine.name == "pinocchio" else _pinocchio()


def engine_identity(stated: EngineName | None = None) -> str:
    """Name the engine that would run, and its version, without an error where it is missing."""
    engine = _available(stated)
    return f"{engine.name} {engine.version}" if engine is not None else "pinocchio, missing"


def _available(stated: EngineName | None) -> Engine | None:
    if stated == "kernels":
        return _kernels()
    return _pinocchio() or (_kernels() if stated is None else None)


def _pinocchio() -> Engine | None:
    try:
        import pinocchio

        from hbm.engines.pinocchio import free_dynamics
    except ImportError:
        return None
    return Engine("pinocchio", pinocchio.__version__, free_dynamics)


@cache
def _kernels() -> Engine:
    from hbm.kernels.native import kernels  # casadi, which takes a moment

    def free_dynamics(
        body: "Body", q: Array, v: Array, a: Array, segments: Collection[str], jobs: int
    ) -> FreeDynamics:
        tau, wrench, motion = kernels().newton_euler(
            q, v, a, body.geometry, body.inertia_vector, jobs=jobs
        )
        motion = motion.reshape(-1, N_Q, 6)
        jacobians = {s: motion[:, np.array(support(LAST_Q[s]))] for s in segments}
        return tau, shift_wrench(wrench, q[:, :3]), jacobians

    return Engine("kernels", f"casadi {version('casadi')}", free_dynamics)


CHECKED_FRAMES: Final = 16
MAX_DIFFERENCE: Final = 1e-8
"""As a share of the frame's largest force or moment: far above rounding (1e-13), far below what a
wrong number in the equations would cause."""
SMALLEST_SCALE: Final = 1.0
"""A frame's largest force or moment counts as at least 1 N or 1 N·m: in free fall all vanish."""

FORCES: Final = (*COORDINATES, *(f"residual {axis}" for axis in WRENCH_COMPONENTS))
IS_FORCE: Final[Mask] = np.array([c.translates for c in TREE] + 3 * [True] + 3 * [False])


def frames_to_check(forces: Sequence[Array]) -> Indices:
    """Choose frames that are spread over those in which all forces, (T, 52) each, are defined."""
    defined = np.flatnonzero(np.isfinite(sum(of_one.sum(axis=1) for of_one in forces)))
    spread = np.linspace(0, len(defined) - 1, min(CHECKED_FRAMES, len(defined)))
    return np.asarray(defined[np.round(spread).astype(int)])


def require_agreement(
    one: Array, other: Array, engines: tuple[str, str], frames: Indices, time: Array
) -> float:
    """Compare the forces that two engines found for the same frames.

    Forces and residual, (F, 52) [N and N·m] each, by two engines, in frames of these numbers and
    times, (F,). Gives the largest difference, as a share of the frame's largest force or moment; a
    ValueError where it exceeds `MAX_DIFFERENCE`.
    """
    share = np.empty_like(one)
    for own in (IS_FORCE, ~IS_FORCE):
        size = np.maximum(np.abs(one[:, own]), np.abs(other[:, own])).max(axis=1, keepdims=True)
        share[:, own] = np.abs(one - other)[:, own] / np.maximum(size, SMALLEST_SCALE)
    share = np.where(np.isnan(share), np.inf, share)
    row, column = np.unravel_index(share.argmax(), share.shape)
    largest = float(share[row, column])
    if largest > MAX_DIFFERENCE:
        unit = "N" if IS_FORCE[column] else "N·m"
        found = ", ".join(
            f"{forces[row, column]:.9g} {unit} by {engine}"
            for forces, engine in zip((one, other), engines, strict=True)
        )
        raise ValueError(
            f"the two engines of inverse dynamics disagree: frame {frames[row]} ({time[row]:.3f} "
            f"s), {FORCES[column]}: {found}; they differ by {largest:.1e} of the frame's largest, "
            f"more than {MAX_DIFFERENCE:g}, so that neither can be trusted; run 'hbm doctor' and "
            "report what it prints"
        )
    return largest
