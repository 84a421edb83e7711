"""A body as text: its segments and joints as tables, then its notes."""

import numpy as np

from hbm.coordinates import PARENT, SEGMENTS, SEGMENTS_WITH_MASS
from hbm.model import Body
from hbm.notes import Note
from hbm.plausibility import implausible
from hbm.spatial import Array


def describe(body: Body) -> str:
    """Describe a body by two tables and its notes.

    Parameters
    ----------
    body
        The subject.

    Returns
    -------
    str
        Segments: mass [kg], length [m], centre of mass in the segment's frame [mm], principal
        moments of inertia [kg·m²]. Joints: position in the parent segment's frame, and in the
        neutral pose with the pelvis at the lab's origin [mm]. Then the body's notes, the locked
        coordinates, and what is implausible.

    Examples
    --------
    With ``body`` from `build_body`:

    >>> import hbm
    >>> for line in hbm.describe(body).splitlines()[2:6]:
    ...     print(line)
    segment             mass   length         centre of mass                   inertia
                          kg        m   mm forward, left, up          kg·m², principal
    pelvis              8.33    0.123       -9     -1     47    0.0383  0.0435  0.0477
    trunk              24.09    0.430      -29     -4    206    0.2470  0.3857  0.5321
    """
    lines = [
        str(body),
        "",
        f"{'segment':16}{'mass':>8}{'length':>9}  {'centre of mass':>21}  {'inertia':>24}",
        f"{'':16}{'kg':>8}{'m':>9}  {'mm forward, left, up':>21}  {'kg·m², principal':>24}",
    ]
    for s in SEGMENTS_WITH_MASS:
        part, length = body.inertias[s], _length(body, s)
        moments = np.linalg.eigvalsh(part.tensor)
        lines.append(
            f"{s:16}{part.mass:8.2f}{f'{length:.3f}' if length else '':>9}  "
            f"{_millimetres(part.center)}  " + "".join(f"{m:8.4f}" for m in moments)
        )
    lines += [
        "",
        f"{'joint of':16}{'in':16}{'mm forward, left, up':>21}  {'from pelvis, neutral':>21}",
    ]
    neutral = {"pelvis": np.zeros(3)}
    for s in SEGMENTS[1:]:
        offset = body.offsets[s]
        neutral[s] = neutral[PARENT[s]] + offset
        lines.append(f"{s:16}{PARENT[s]:16}{_millimetres(offset)}  {_millimetres(neutral[s])}")
    locked = [Note.of("coordinates_locked", coordinates=body.locked)] if body.locked else []
    notes = (*body.notes, *locked, *implausible(body))
    return "\n".join([*lines, "", *map(str, notes)])


def _length(body: Body, s: str) -> float | None:
    """Length of a segment's inertial part; for the trunk, of both its parts."""
    parts = {"pelvis": ["lower_trunk"], "trunk": ["mid_trunk", "upper_trunk"]}.get(s, [s])
    lengths = [body.lengths[p] for p in parts if p in body.lengths]
    return sum(lengths) if lengths else None


def _millimetres(point: Array) -> str:
    return "".join(f"{round(1000 * float(x)):7d}" for x in point)
