"""In which frames of a trial the plates bear the weight of the subject."""

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from hbm.body import Body
from hbm.dynamics import Dynamics
from hbm.signals.filtering import low_pass
from hbm.spatial import GRAVITY_MPS2, Array, Mask
from pipeline.config.schema import Settings
from pipeline.io.recording import Event
from pipeline.trial.delay import plate_delay
from pipeline.trial.gait.carried import carried_frames
from pipeline.trial.gait.contact import SharedPlates
from pipeline.trial.ground.wrenches import Ground
from pipeline.trial.plate_check import rest_level


def weight_bearing_frames(
    body: Body,
    time: Array,
    ground: Ground,
    shared: Mapping[str, SharedPlates],
    dynamics: Mapping[str, Dynamics],
    events: Sequence[Event],
    settings: Settings,
) -> Mask:
    """Find the frames in which the plates carry the subject.

    Parameters
    ----------
    body
        The subject.
    time
        (T,) [s].
    ground
        The plates' wrenches, as measured and compensated.
    shared, dynamics
        The same by foot, and inverse dynamics with them.
    events
        Gait events.
    settings
        Filter and threshold of contact.

    Returns
    -------
    Mask
        (T,). What a plate reads at rest is subtracted first. Plates as measured and compensated,
        with and without the delay that the motion shows, are judged by
        `pipeline.trial.gait.carried`, and the judgement in which they carry the subject in most
        frames is taken: a wrong offset, delay or calibration is no foot beside the plates. Frames
        in which a plate has no value do not count.
    """
    weight_n = body.mass * GRAVITY_MPS2
    found, defined = [], np.ones(len(time), bool)
    for variant, plates in ground.variants.items():
        forces = np.stack([wrench[:, :3] for wrench in plates])
        forces = np.stack(
            [low_pass(each, time, settings.cutoff_hz, settings.filter) for each in forces]
        )
        total, residual = forces.sum(axis=0), dynamics[variant].residual[:, :3]
        defined &= np.isfinite(total).all(axis=1)
        at_rest = [rest_level(wrench[:, 2], time, weight_n) or 0.0 for wrench in plates]
        vertical = forces[..., 2] - np.reshape(at_rest, (-1, 1))
        judge = partial(
            carried_frames,
            time,
            total[:, 2] + residual[:, 2],
            weight_n=weight_n,
            events=events,
            feet=shared[variant].by_foot,
            threshold_n=settings.contact_threshold_n,
            cutoff_hz=settings.cutoff_hz,
            method=settings.filter,
        )
        found.append(judge(vertical))
        if found[-1].all():
            continue
        later = time + np.nan_to_num(plate_delay(total, residual, time).delay_s)
        found.append(judge(np.stack([np.interp(later, time, each) for each in vertical])))
    return np.asarray(max(found, key=np.count_nonzero) & defined)
