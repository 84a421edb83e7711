"""How sure a trial's residuals are over the gait cycle."""

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from compensation.inertia.sensors import QUANTILE_95
from hbm.spatial import Array
from pipeline.explain.budget import Bands
from pipeline.figures.residuals import label_panels, legend_below, six_panels
from pipeline.figures.style import BAND_OPACITY, PALETTE, STYLE
from pipeline.trial.gait.cycles import mean_and_sd, normalise


def bands_figure(bands: Bands, name: str) -> Figure:
    """Draw the mean gait cycle of each residual, with two bands.

    Parameters
    ----------
    bands
        Of a trial.
    name
        Of the trial.

    Returns
    -------
    matplotlib.figure.Figure
        Six panels over the gait cycle; forces above, moments below. The wide band is the 95 %
        interval of measurement: what causes of usual size change the residual by. It is much the
        same in all cycles. The narrow one is one standard deviation between cycles.
    """
    spans = _spans(bands)
    mean, between = mean_and_sd(normalise(bands.time, bands.residual, spans))
    variance = normalise(bands.time, bands.deviation**2, spans)
    half = QUANTILE_95 * np.sqrt(np.nanmean(variance, axis=0))
    percent = np.linspace(0, 100, len(mean))
    with mpl.rc_context(STYLE):
        figure, panels = six_panels()
        label_panels(panels)
        for k, panel in enumerate(panels):
            for spread, colour, label in (
                (half[:, k], PALETTE[1], "95 % interval of measurement"),
                (between[:, k], PALETTE[0], "SD between cycles"),
            ):
                low, high = mean[:, k] - spread, mean[:, k] + spread
                panel.fill_between(
                    *(percent, low, high), color=colour, alpha=BAND_OPACITY, lw=0, label=label
                )
            panel.plot(percent, mean[:, k], label="mean")
        legend_below(figure, panels[0])
        figure.suptitle(
            f"{name}: pelvis residuals of {len(spans)} gait cycles with 95 % intervals",
            fontsize=10,
        )
    return figure


def _spans(bands: Bands) -> Array:
    """Give start and stop of the cycles, (C, 2) [s]."""
    first = np.flatnonzero(np.diff(bands.cycle, prepend=-1))
    last = np.append(first[1:], len(bands.cycle)) - 1
    return np.column_stack([bands.time[first], bands.time[last]])
