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


@dataclass(frozen=True, slots=True)
class FreeDynamics:
    """What a motion needs where nothing but gravity acts on the body.

    Attributes
    ----------
    tau
        Generalized forces of the 46 coordinates, (T, 46) [N and N·m].
    wrench
        Wrench needed at the pelvis, (T, 6) [N, N·m]: lab axes, about mid-hip.
    jacobians
        Segment -> motion of the segment per unit rate of each of the C coordinates that carry it,
        (T, C, 6): velocity of the point at the lab origin, angular velocity, lab axes; coordinates
        in the order of `hbm.coordinates.support`. The product with a wrench on the segment about
        the lab origin is the wrench's generalized forces.
    """

    tau: Array
    wrench: Array
    jacobians: Mapping[str, Array]


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

    Examples
    --------
    >>> print(EngineUsed("pinocchio", "4.1.0", "kernels", "casadi 3.8.2", 16, 2e-13))
    Pinocchio 4.1.0
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
        if self.other is None:
            return Note.of("engine_unchecked", engine=str(self))
        return Note.of(
            "engine_checked",
            engine=str(self),
            other=title(self.other, self.other_version),
            frames=self.frames,
            difference=self.difference,
        )


def title(name: EngineName, version: str) -> str:
    """Give an engine and its version as they are written in texts."""
    return f"Pinocchio {version}" if name == "pinocchio" else f"kernels ({version})"


def choose_engine(stated: EngineName | None = None) -> Engine:
    """Give the engine to run.

    Parameters
    ----------
    stated
        Which; None for Pinocchio where it can be imported, else the kernels.

    Returns
    -------
    Engine
        Ready to run.

    Raises
    ------
    ValueError
        If there is no such engine, or it cannot be imported.

    Examples
    --------
    >>> choose_engine("kernels").name
    'kernels'
    """
    if stated is not None and stated not in ENGINES:
        raise ValueError(f"engine must be one of {', '.join(ENGINES)}, got {stated!r}")
    engine = _available(stated)
    if engine is not None:
        return engine
    raise ValueError(
        'engine = "pinocchio" is stated, but Pinocchio cannot be imported here; install it (pip '
        'install pin), leave engine out, or state engine = "kernels"'
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
    return Engine("pinocchio", pinocchio.__version__, lambda *of: FreeDynamics(*free_dynamics(*of)))


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
        return FreeDynamics(tau, shift_wrench(wrench, q[:, :3]), jacobians)

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

    Parameters
    ----------
    one, other
        46 generalized forces, then the residual, (F, 52) [N and N·m] each.
    engines
        What to call the one and the other.
    frames, time
        Numbers and times of the frames in the motion, (F,).

    Returns
    -------
    float
        The largest difference, as a share of the frame's largest force or moment.

    Raises
    ------
    ValueError
        If it exceeds `MAX_DIFFERENCE`.
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
