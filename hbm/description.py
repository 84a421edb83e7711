"""A body as text: its segments and joints as tables, then its notes."""

import numpy as np

from hbm.coordinates import PARENT
from hbm.model import Body
from hbm.notes import Note
from hbm.plausibility.motion import implausible
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
    >>> for line in hbm.describe(body).splitlines()[2:7]:
    ...     print(line)
    segment             mass   length         centre of mass                   inertia
                          kg        m   mm forward, left, up          kg·m², principal
    pelvis              8.33    0.127       -9     -1     48    0.0407  0.0462  0.0507
    mid_trunk          12.18    0.188      -27     -4    112    0.0629  0.0939  0.0996
    thorax             11.91    0.272      -32     -4    330    0.0901  0.1903  0.2244
    """
    lines = [
        str(body),
        "",
        f"{'segment':16}{'mass':>8}{'length':>9}  {'centre of mass':>21}  {'inertia':>24}",
        f"{'':16}{'kg':>8}{'m':>9}  {'mm forward, left, up':>21}  {'kg·m², principal':>24}",
    ]
    for s, part in body.segments.items():
        length = body.lengths.get(s)
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
    for s, offset in body.offsets.items():
        neutral[s] = neutral[PARENT[s]] + offset
        lines.append(f"{s:16}{PARENT[s]:16}{_millimetres(offset)}  {_millimetres(neutral[s])}")
    locked = [Note.of("coordinates_locked", coordinates=body.locked)] if body.locked else []
    notes = (*body.notes, *locked, *implausible(body))
    return "\n".join([*lines, "", *map(str, notes)])


def _millimetres(point: Array) -> str:
    return "".join(f"{round(1000 * float(x)):7d}" for x in point)
