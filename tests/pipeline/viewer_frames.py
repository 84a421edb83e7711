"""Frames of a processed trial, as a live view is shown them."""

import numpy as np

from pipeline.trial.residuals import reported
from pipeline.viewer.live import ShownFrame


def shown_frames(trial) -> list[ShownFrame]:
    """Give all frames of a trial."""
    residuals = {name: reported(each.residual) for name, each in trial.variants.items()}
    ground = {name: np.stack(list(feet.values()), 1) for name, feet in trial.ground.items()}
    pose = trial.platform
    return [
        ShownFrame(
            time=float(trial.motion.time[k]),
            q=trial.motion.q[k],
            markers=trial.markers.position[k],
            residual={name: value[k] for name, value in residuals.items()},
            ground={name: value[k] for name, value in ground.items()},
            platform=pose and (pose.rotation[k], pose.position[k]),
            counts=bool(trial.counts[k]),
        )
        for k in range(len(trial.motion.time))
    ]
