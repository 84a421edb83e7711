"""In which frames of a trial the plates bear the weight of the subject."""

from collections.abc import Sequence

import numpy as np

from hbm.body import Body
from hbm.motion import Motion
from hbm.spatial import GRAVITY_MPS2, Array, Mask
from pipeline.config.schema import Settings
from pipeline.io.recording import Plate
from pipeline.trial.gait.carried import Support, places_of
from pipeline.trial.gait.contact import SharedPlates
from pipeline.trial.ground.wrenches import Ground
from pipeline.trial.plate_check import rest_level


def weight_bearing_frames(
    body: Body,
    motion: Motion,
    plates: Sequence[Plate],
    ground: Ground,
    under_feet: SharedPlates,
    vertical: tuple[Array, Array],
    settings: Settings,
) -> Mask:
    """Find the frames in which the plates carry the subject.

    Parameters
    ----------
    body, motion
        The subject, and the filtered motion.
    plates, ground, under_feet
        Where the plates are, their wrenches, and whose foot each carries.
    vertical
        Vertical force that the motion needs, and that of all plates, filtered, (T,) each [N].
    settings
        Filter and threshold of contact.

    Returns
    -------
    Mask
        (T,), by `pipeline.trial.gait.carried.Support`, without what plates read at rest unless the
        filter is the real-time one.
    """
    best, at_rest = ground.variants[ground.best], None
    if settings.filter != "realtime":
        weight_n = body.mass * GRAVITY_MPS2
        at_rest = np.array([rest_level(w[:, 2], motion.time, weight_n) or 0.0 for w in best])
    support = Support(
        body,
        [plate.corners for plate in plates],
        settings.contact_threshold_n,
        settings.cutoff_hz,
        settings.filter,
        at_rest,
    )
    pose = None if ground.pose is None else (ground.pose.rotation, ground.pose.position)
    return support.carried(
        support.feet(motion.time, places_of(body, motion.q), pose),
        np.stack(best, axis=1),
        np.column_stack(under_feet.foot_of_plates),
        *vertical,
        pose,
    )
