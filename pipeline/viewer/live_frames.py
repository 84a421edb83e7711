"""What passes to the process that draws a live view; frames as one row of numbers each."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from math import prod
from struct import Struct
from typing import Final, Literal

import numpy as np

from compensation.platform import PlatformPose
from hbm.model import Body
from hbm.spatial import Array, Mask
from pipeline.trial.result import PlateSurface

Screen = Literal["window", "browser", "none"]
"""A window of its own, a page for a browser of this machine, or pictures that nobody sees."""
HEAD: Final = Struct("4d")
"""Number, time, whether it counts, whether the platform moves."""
NEUTRAL: Final = (np.eye(3), np.zeros(3))


@dataclass(frozen=True, slots=True, eq=False)
class ShownFrame:
    """What a live view shows of one frame.

    Attributes
    ----------
    time
        [s], on any clock that does not jump; shown is the time since the first frame.
    q
        Coordinates, (46,) [m and rad]; NaN where the body is not known, which hides it.
    markers
        Measured markers in the lab, (M, 3) [m]; NaN where one is not seen.
    residual
        "measured" and, with a calibration, "compensated" -> residual on the pelvis in the reported
        axes (x forward, y right, z up), (6,) [N, N·m].
    ground
        The same -> wrench on the left and the right foot in lab axes about the lab origin, (2, 6)
        [N, N·m].
    platform
        Rotation, (3, 3), and position, (3,) [m], of the platform in the lab, NaN where unknown;
        None where it stands still.
    counts
        Whether the residual counts; it is not shown where it does not.
    """

    time: float
    q: Array
    markers: Array
    residual: Mapping[str, Array]
    ground: Mapping[str, Array]
    platform: tuple[Array, Array] | None = None
    counts: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class FrameBlock:
    """Successive frames; fields as of `ShownFrame`, with a first axis of T frames.

    Attributes
    ----------
    number
        Which frames of all shown ones these are, (T,); one that is missing was left out.
    residual
        NaN where a frame does not count.
    """

    number: Array
    time: Array
    q: Array
    markers: Array
    residual: Mapping[str, Array]
    ground: Mapping[str, Array]
    platform: PlatformPose | None

    def __getitem__(self, rows: slice | Mask) -> "FrameBlock":
        """Give some of the frames."""
        pose = self.platform
        return FrameBlock(
            self.number[rows],
            self.time[rows],
            self.q[rows],
            self.markers[rows],
            {variant: value[rows] for variant, value in self.residual.items()},
            {variant: value[rows] for variant, value in self.ground.items()},
            pose and PlatformPose(pose.rotation[rows], pose.position[rows]),
        )


@dataclass(frozen=True, slots=True, eq=False)
class LiveScene:
    """What stays while frames are shown.

    Attributes
    ----------
    body
        The subject.
    plates
        Where the plates are with the platform in neutral.
    markers
        Names of the markers.
    variants
        "measured" and, with a calibration, "compensated".
    contact_threshold_n
        A foot with less vertical force has no arrow [N].
    screen
        Where it is drawn.
    """

    body: Body
    plates: Sequence[PlateSurface]
    markers: Sequence[str]
    variants: Sequence[str]
    contact_threshold_n: float
    screen: Screen


@dataclass(frozen=True, slots=True, eq=False)
class LiveNews:
    """What is new since the last time.

    Attributes
    ----------
    rows
        Of the frames, as `FrameRows` packs them, one after the other.
    cycles
        Side, and variant -> residuals over 0 to 100 % in the reported axes, (101, 6) [N, N·m].
    status
        Text in Markdown; None where it is the same.
    """

    rows: bytes
    cycles: Sequence[tuple[str, Mapping[str, Array]]]
    status: str | None


@dataclass(frozen=True)
class FrameRows:
    """Where the numbers of a frame are in its row.

    Attributes
    ----------
    markers
        How many markers there are.
    variants
        Names of the variants.

    Examples
    --------
    >>> rows = FrameRows(1, ("measured",))
    >>> frame = ShownFrame(0.5, np.zeros(46), np.zeros((1, 3)), {"measured": np.arange(6.0)},
    ...                    {"measured": np.zeros((2, 6))})
    >>> block = rows.unpack(rows.pack(7, frame))
    >>> block.number, block.time, block.residual["measured"]
    (array([7.]), array([0.5]), array([[0., 1., 2., 3., 4., 5.]]))
    """

    markers: int
    variants: Sequence[str]

    @cached_property
    def shapes(self) -> list[tuple[int, ...]]:
        """Shapes of a row's arrays.

        They are coordinates, markers, rotation and position of the platform; residual and ground
        reaction of each variant.
        """
        each = [(6,), (2, 6)] * len(self.variants)
        return [(46,), (self.markers, 3), (3, 3), (3,), *each]

    @cached_property
    def size(self) -> int:
        """Bytes of a row."""
        return HEAD.size + 8 * sum(map(prod, self.shapes))

    def pack(self, number: int, frame: ShownFrame) -> bytes:
        """Give the row of a frame, a copy of all that it holds.

        Raises
        ------
        ValueError
            If an array has another shape than the view was made for, or another type than double.
        KeyError
            If a variant is missing.
        """
        parts = [frame.q, frame.markers, *(frame.platform or NEUTRAL)]
        for variant in self.variants:
            parts += (frame.residual[variant], frame.ground[variant])
        found = [part.shape for part in parts]
        head = HEAD.pack(number, frame.time, frame.counts, frame.platform is not None)
        row = head + b"".join([part.tobytes() for part in parts])
        if found != self.shapes or len(row) != self.size:
            raise ValueError(
                f"a frame to show must hold arrays of doubles of {self.shapes}, got {found}"
            )
        return row

    def unpack(self, rows: bytes) -> FrameBlock:
        """Give the frames of rows, one after the other."""
        table = np.frombuffer(rows).reshape(-1, self.size // 8)
        ends = accumulate([HEAD.size // 8, *map(prod, self.shapes)])
        head, *flat = np.split(table, list(ends)[:-1], axis=1)
        q, markers, rotation, position, *each = (
            part.reshape(len(table), *shape) for part, shape in zip(flat, self.shapes, strict=True)
        )
        counts = head[:, 2:3] > 0
        return FrameBlock(
            number=head[:, 0],
            time=head[:, 1],
            q=q,
            markers=markers,
            residual={
                name: np.where(counts, value, np.nan)
                for name, value in zip(self.variants, each[::2], strict=True)
            },
            ground=dict(zip(self.variants, each[1::2], strict=True)),
            platform=_pose(rotation, position) if head[:, 3].any() else None,
        )


def _pose(rotation: Array, position: Array) -> PlatformPose:
    unknown = np.isnan(np.column_stack([rotation.reshape(-1, 9), position])).any(axis=1)
    rotation, position = rotation.copy(), position.copy()
    rotation[unknown], position[unknown] = np.nan, np.nan
    return PlatformPose(rotation, position)
