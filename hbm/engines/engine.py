"""What an engine of inverse dynamics is, and which one computed a result."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal, get_args

from hbm.notes import Note
from hbm.spatial import Array

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
