"""The table of what each fault adds, as a picture."""

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from pipeline.figures import STYLE

LEAST, MOST = 0.1, 300.0


def ablation_figure(table: pd.DataFrame) -> Figure:
    """Draw what each fault adds to each residual, a panel per condition.

    Parameters
    ----------
    table
        As `pipeline.virtual_lab.ablation.ablation` gives it.

    Returns
    -------
    matplotlib.figure.Figure
        Rows are faults, columns residuals; numbers are the RMS added, in N and N·m, shaded by size.
    """
    conditions = list(dict.fromkeys(table["condition"]))
    cases = list(dict.fromkeys(table["case"]))
    axes = table[["axis", "unit"]].drop_duplicates()
    with mpl.rc_context(STYLE):
        size = 2.2 + 2.6 * len(conditions), 1.2 + 0.26 * len(cases)
        figure = Figure(figsize=size, layout="constrained")
        panels = figure.subplots(1, len(conditions), sharey=True, squeeze=False)[0]
        for panel, condition in zip(panels, conditions, strict=True):
            chosen = table[table["condition"] == condition]
            added = chosen.pivot(index="case", columns="axis", values="added")
            values = added.loc[cases, axes["axis"]].to_numpy()
            shade = np.clip(values, LEAST, MOST)
            panel.imshow(shade, norm=LogNorm(LEAST, MOST), cmap="cividis_r", aspect="auto")
            for (row, column), value in np.ndenumerate(values):
                dark = value > np.sqrt(LEAST * MOST)
                text = f"{value:.0f}" if value >= 9.95 else f"{value:.1f}"
                colour = "white" if dark else "black"
                panel.text(column, row, text, ha="center", va="center", color=colour, size=7)
            labels = [f"{axis}\n{unit}" for axis, unit in axes.itertuples(index=False)]
            panel.set_xticks(range(len(labels)), labels)
            panel.set_yticks(range(len(cases)), cases)
            panel.tick_params(length=0)
            panel.set_title(condition)
            for spine in panel.spines.values():
                spine.set_visible(False)
        figure.suptitle("What each fault alone adds to the pelvis residuals, RMS", fontsize=10)
    return figure
