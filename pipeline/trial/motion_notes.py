"""What became of a motion's coordinates and frames, in sentences."""

import numpy as np

from hbm.body import Body
from hbm.motion import Motion


def motion_notes(body: Body, motion: Motion) -> list[str]:
    """Say what was locked, bridged or not solved."""
    notes = []
    if body.locked:
        notes.append(f"locked at neutral, for no marker shows them: {', '.join(body.locked)}")
    locked = np.array([name in body.locked for name in motion.names])
    lost = (~motion.observed & motion.converged[:, None])[:, ~locked]
    if lost.any():
        names = np.array(motion.names)[~locked][lost.any(axis=0)]
        notes.append(
            f"bridged in time over {np.count_nonzero(lost.any(axis=1))} frames without enough "
            f"markers: {', '.join(names)}"
        )
    gaps = int(np.isnan(motion.marker_error).sum())
    if gaps:
        notes.append(f"{gaps} marker samples are missing and were left out of the fit")
    failed = int(np.count_nonzero(~motion.converged))
    if failed:
        notes.append(f"{failed} of {len(motion.time)} frames could not be solved")
    return notes
