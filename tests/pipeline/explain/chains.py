"""Chains of a person whose markers sit where the model has them, on plates that measure nothing."""

import numpy as np

from hbm.coordinates import INDEX, N_Q
from hbm.kinematics import solve_ik
from hbm.markers import Markers
from hbm.poses import marker_positions
from pipeline.config.schema import Settings
from pipeline.explain.processing_chain import ProcessingChain
from tests.synthetic import synthetic_body


def chain_of(time, coordinates):
    """Give the chain of a motion: coordinate -> its course over time; the others stay at zero."""
    body, settings = synthetic_body(), Settings()
    q = np.zeros((len(time), N_Q))
    for name, course in coordinates.items():
        q[:, INDEX[name]] = course
    markers = Markers(time, body.markers, marker_positions(body, q))
    q = solve_ik(body, markers).q
    return ProcessingChain(
        time=time,
        settings=settings,
        body=body,
        markers=markers,
        q=q,
        plates=(),
        wrenches=(),
        pose=None,
    )
