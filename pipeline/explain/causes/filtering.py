"""What filtering coordinates and forces, each on its own, leaves in a residual."""

from typing import Final

from hbm.spatial import Array
from pipeline.explain.processing_chain import ProcessingChain

TRANSPARENT: Final = 4.0
"""Cut-off that passes nearly all of a motion, in cut-offs of the trial: at 6 Hz, 24 Hz."""
HIGHEST: Final = 0.3
"""Of the frame rate: a filter's cut-off has to stay well below half of it."""


def left_by_filter(chain: ProcessingChain) -> Array:
    """Compute what the filter leaves in the residual, (T, 6) [N, N·m].

    The equations of motion multiply coordinates with each other and forces with positions, and the
    product of filtered signals is not the filtered product. The residual of signals that hardly
    pass a filter, itself passed through the filter of the trial, has no such part; it is what a
    filter leaves of all other causes. Lab axes about the pelvis origin.

    Parameters
    ----------
    chain
        The trial.

    Returns
    -------
    Array
        Residual of filtered signals less the filtered residual; zero where both are the same.
    """
    cutoff_hz = chain.settings.cutoff_hz
    rate_hz = (len(chain.time) - 1) / (chain.time[-1] - chain.time[0])
    higher_hz = min(TRANSPARENT * cutoff_hz, HIGHEST * rate_hz)
    if higher_hz <= cutoff_hz:
        return chain.residual * 0.0
    settings = chain.settings.model_copy(update={"cutoff_hz": higher_hz, "filter": "zero_phase"})
    return chain.residual - chain.low_pass(chain.changed(settings=settings).residual)
