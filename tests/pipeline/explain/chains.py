"""Chains of a person whose markers sit where the model has them, on plates that measure nothing."""

from pathlib import Path

import numpy as np

from hbm.coordinates import INDEX, N_Q
from hbm.ik.tracking import solve_ik
from hbm.markers import Markers
from hbm.poses import marker_positions
from pipeline.config.schema import Settings, Subject, Treadmill
from pipeline.io.recording import Recording
from pipeline.trial.chain import Chain
from pipeline.trial.ground.laboratory import BoundLaboratory, Laboratory
from pipeline.trial.inputs import Inputs
from tests.synthetic import synthetic_body


def chain_of(time, coordinates, only=None):
    """Give the chain of a motion: coordinate -> its course over time; the others stay at zero.

    All segments have markers, or only one.
    """
    body, settings = synthetic_body(), Settings()
    q = np.zeros((len(time), N_Q))
    for name, course in coordinates.items():
        q[:, INDEX[name]] = course
    seen = [k for k, on in enumerate(body.marker_segment) if only in (None, on)]
    names = tuple(body.markers[k] for k in seen)
    markers = Markers(time, names, marker_positions(body, q)[:, seen])
    q = solve_ik(body, markers).q
    recording = Recording(Path("made.c3d"), markers)
    inputs = Inputs(recording=recording, subject=Subject(), laboratory=Laboratory(Treadmill()))
    return Chain(inputs, settings).changed(
        body=body,
        markers=markers,
        q=q,
        wrenches=(),
        platform=None,
        accelerations=(),
        belts=(),
        lab=BoundLaboratory(recording, inputs.laboratory, ()),
    )
