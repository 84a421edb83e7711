"""Inverse kinematics: all coordinates of all frames from all markers at once.

Every frame is a least-squares problem of its own (Lu and O'Connor 1999, J Biomech 32:129), solved
by damped Newton steps until the undamped step is below the tolerance (`hbm.ik.descent`), from
starting points that `hbm.ik.tracking` finds.
"""

from collections.abc import Mapping

import numpy as np

from hbm.ik.problem import Problem
from hbm.ik.tracking import solve_trial
from hbm.markers import Markers
from hbm.model import Body
from hbm.motion import Motion


def solve_ik(
    body: Body,
    markers: Markers,
    *,
    weights: Mapping[str, float] | None = None,
    tolerance: float = 1e-6,
    jobs: int = 1,
) -> Motion:
    """Find the coordinates whose markers lie nearest to the measured ones.

    Parameters
    ----------
    body
        The subject.
    markers
        Measured trajectories, lab axes; gaps are NaN. Labels that the body does not know are
        ignored.
    weights
        Marker -> weight in the sum of squares; 1 where not named.
    tolerance
        Largest last step of any coordinate [rad or m]; convergence is quadratic, so the error that
        remains is far smaller.
    jobs
        Threads.

    Returns
    -------
    Motion
        ``q``, marker errors and which coordinates were observed; ``v`` and ``a`` are NaN until
        `filter_motion`. What the markers of the trial do not determine is held near zero by a prior
        (`hbm.ik.problem`), what none of them shows at zero; coordinates that lose their markers for
        a while, and limbs whose markers fit no pose, are interpolated in time.
        Only a pelvis or a trunk that markers do not show leaves a frame unsolved.

    Raises
    ------
    ValueError
        If none of the body's markers is in the trial, or a weight is negative or of a marker that
        the body does not have.

    Examples
    --------
    With ``static``, the markers of a T-pose, and ``body``, built from them:

    >>> import hbm, numpy as np
    >>> motion = hbm.solve_ik(body, static)
    >>> f"{1000 * motion.marker_error.max():.3f} mm"
    '0.000 mm'
    >>> f"{np.degrees(motion.coordinate('LShoulderAbduction').mean()):.0f}°"
    '94°'
    """
    for name, weight in (weights or {}).items():
        if name not in body.markers:
            raise ValueError(f"weight for {name!r}, which is not a marker of the body")
        if not (weight >= 0 and np.isfinite(weight)):
            raise ValueError(f"the weight of {name} must be 0 or more, got {weight:g}")
    problem = Problem(body, markers, weights or {}, tolerance=tolerance, jobs=jobs)
    return solve_trial(problem)
