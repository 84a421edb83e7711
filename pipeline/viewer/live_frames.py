"""What passes to the process that draws a live view; frames as one row of numbers each."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from math import prod
from typing import Literal

import numpy as np

from compensation.platform.pose import PlatformPose
from hbm.model import Body
from hbm.spatial import Array, Mask
from pipeline.trial.result import PlateSurface

Screen = Literal["window", "browser", "none"]
"""A window of its own, a page for a browser of this machine, or pictures that nobody sees."""


@dataclass(frozen=True, slots=True, eq=False)
class ShownFrame:
    """What a live view shows of one frame.

    Attributes
    ----------
    time
        [s], on any clock that does not jump.
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
        Of the frames, (T, K), as `FrameRows` packs them.
    cycles
        Side, and variant -> residuals over 0 to 100 % in the reported axes, (101, 6) [N, N·m].
    status
        Text in Markdown; None where it is the same.
    """

    rows: Array
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
    >>> block = rows.unpack(np.array([rows.pack(7, frame)]))
    >>> block.number, block.time, block.residual["measured"]
    (array([7.]), array([0.5]), array([[0., 1., 2., 3., 4., 5.]]))
    """

    markers: int
    variants: Sequence[str]

    @cached_property
    def shapes(self) -> tuple[tuple[int, ...], ...]:
        """Shapes of a row's parts.

        They are number, time, whether it counts, whether the platform moves; coordinates, markers,
        rotation and position of the platform; residual and ground reaction of each variant.
        """
        each = ((6,), (2, 6)) * len(self.variants)
        return ((4,), (46,), (self.markers, 3), (3, 3), (3,), *each)

    def pack(self, number: int, frame: ShownFrame) -> Array:
        """Give the row of a frame, a copy of all that it holds.

        Raises
        ------
        ValueError
            If an array has another shape than the view was made for.
        KeyError
            If a variant is missing.
        """
        rotation, position = frame.platform or (np.eye(3), np.zeros(3))
        parts = [
            np.array([number, frame.time, frame.counts, frame.platform is not None], float),
            frame.q,
            frame.markers,
            rotation,
            position,
        ]
        for variant in self.variants:
            parts += [frame.residual[variant], frame.ground[variant]]
        found = tuple(part.shape for part in parts)
        if found != self.shapes:
            raise ValueError(f"a frame to show must hold arrays of {self.shapes}, got {found}")
        return np.concatenate(parts, axis=None)

    def unpack(self, rows: Array) -> FrameBlock:
        """Give the frames of (T, K) rows."""
        ends = list(accumulate(map(prod, self.shapes)))
        flat = np.split(rows, ends[:-1], axis=1)
        head, q, markers, rotation, position, *each = (
            part.reshape(len(rows), *shape) for part, shape in zip(flat, self.shapes, strict=True)
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
