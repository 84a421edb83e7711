"""Layouts saved with a recording: which view is where when it is opened."""

from collections.abc import Sequence
from typing import Final, Literal

import numpy as np
import rerun.blueprint as rrb

from hbm.spatial import Array
from pipeline.trial.residuals import AXES, DIRECTIONS, UNITS
from pipeline.viewer.cycles import BACKGROUND, HEIGHT, SHOWN_CYCLES, WIDTH
from pipeline.viewer.file import rgba
from pipeline.viewer.scene import GROUND_SCALE, RESIDUAL_SCALES

WINDOW_S: Final = 2.0
"""Time shown before and after the cursor: about two gait cycles each."""
LIVE_WINDOW_S: Final = 10.0
"""Time shown of what is going on: about nine gait cycles."""
GRID_SPACING_M: Final = 0.25
CYCLE_CURVES: Final = (
    "Mean (thick) ± SD (thin) over the gait cycle: measured vermilion, compensated blue"
)
EYE_FROM_TARGET_M: Final = np.array([1.5, -1.9, 0.35])
"""The camera is ahead of the subject, to the right, slightly above the pelvis."""
PATH_IN_VIEW_M: Final = 2.5
"""The camera is twice as far away where the pelvis travels this far, and so on in proportion."""


def trial_layout(pelvis: Array, *, phases: bool, figure: bool) -> rrb.Blueprint:
    """Lay out a trial: scene and gait phases, residuals over time, summary.

    Parameters
    ----------
    pelvis
        The pelvis origin over time, (T, 3) [m]; the camera looks at its middle.
    phases
        Whether there are gait phases or other states over time.
    figure
        Whether there is a figure over the gait cycle.
    """
    window = rrb.VisibleTimeRange(
        "time",
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-WINDOW_S),
        end=rrb.TimeRangeBoundary.cursor_relative(seconds=WINDOW_S),
    )
    whole = rrb.VisibleTimeRange(
        "time", start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.infinite()
    )
    states = rrb.StateTimelineView(
        name="Gait phases",
        origin="phases",
        time_view=rrb.archetypes.TimeAxis(view_range=window.range),
    )
    errors = rrb.TimeSeriesView(
        name="Marker errors (mm)",
        origin="marker_error_mm",
        time_ranges=whole,
        axis_x=rrb.archetypes.TimeAxis(view_range=whole.range),
    )
    summary = rrb.TextDocumentView(name="Summary", origin="summary")
    legend = rrb.TextDocumentView(name="Legend", origin="legend")
    cycle = rrb.Spatial2DView(name="Over the gait cycle", origin="gait_cycle")
    return _with_panels(
        rrb.Horizontal(
            rrb.Vertical(
                _scene(pelvis, f"{GROUND_SCALE}, {RESIDUAL_SCALES}"),
                *([states] if phases else []),
                row_shares=[3, 1][: 1 + phases],
            ),
            rrb.Tabs(
                _residuals("Residuals around the cursor", window),
                _residuals("Residuals, whole trial", whole),
                errors,
            ),
            rrb.Tabs(summary, legend, *([cycle] if figure else [])),
            column_shares=[4, 4, 3],
        ),
        "time",
    )


def live_layout(target: Array) -> rrb.Blueprint:
    """Lay out a live view: scene and status, residuals over time and over the gait cycle.

    Parameters
    ----------
    target
        Where the camera looks, (3,) [m].
    """
    recent = rrb.VisibleTimeRange(
        "time",
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-LIVE_WINDOW_S),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
    cycles = rrb.Spatial2DView(
        name=f"Last {SHOWN_CYCLES} gait cycles of the right foot (else left), the newest brightest",
        origin="cycles",
        visual_bounds=rrb.VisualBounds2D(x_range=[0, WIDTH], y_range=[0, HEIGHT]),
        background=rgba(BACKGROUND)[0],
    )
    return _with_panels(
        rrb.Horizontal(
            rrb.Vertical(
                _scene(target[None], f"{GROUND_SCALE}, {RESIDUAL_SCALES}"),
                rrb.Tabs(
                    rrb.TextDocumentView(name="Status", origin="status"),
                    rrb.TextDocumentView(name="Legend", origin="legend"),
                ),
                row_shares=[3, 2],
            ),
            rrb.Vertical(
                _residuals("The last seconds", recent, order=(0, 1, 2, 3, 4, 5)),
                cycles,
                row_shares=[3, 2],
            ),
            column_shares=[2, 3],
        ),
        "time",
        "following",
    )


def cycle_layout(pelvis: Array) -> rrb.Blueprint:
    """Lay out the mean gait cycle: mean stick figure and residuals, mean ± SD.

    Parameters
    ----------
    pelvis
        The mean pelvis origin over the cycle, (101, 3) [m].
    """
    every = rrb.VisibleTimeRange(
        "gait_cycle_percent",
        start=rrb.TimeRangeBoundary.infinite(),
        end=rrb.TimeRangeBoundary.infinite(),
    )
    return _with_panels(
        rrb.Horizontal(
            _scene(pelvis, RESIDUAL_SCALES),
            rrb.Tabs(_residuals(CYCLE_CURVES, every, legend=False)),
            column_shares=[1, 2],
        ),
        "gait_cycle_percent",
    )


def _scene(pelvis: Array, scales: str) -> rrb.Spatial3DView:
    middle = np.nanmedian(pelvis, axis=0)
    path = float(np.max(np.nanmax(pelvis, axis=0) - np.nanmin(pelvis, axis=0)))
    eye = middle + (1 + path / PATH_IN_VIEW_M) * EYE_FROM_TARGET_M
    return rrb.Spatial3DView(
        name=f"Arrows: {scales}",
        origin="lab",
        line_grid=rrb.LineGrid3D(visible=True, spacing=GRID_SPACING_M),
        eye_controls=rrb.EyeControls3D(position=eye, look_target=middle, eye_up=(0, 0, 1)),
    )


def _residuals(
    name: str,
    shown: rrb.VisibleTimeRange,
    *,
    legend: bool = True,
    order: Sequence[int] = (0, 3, 1, 4, 2, 5),
) -> rrb.Grid:
    """Give six panels, forces on the left and moments on the right, or in another order of axes."""
    panels = [
        rrb.TimeSeriesView(
            name=f"{AXES[k]} {'about ' if k > 2 else ''}{DIRECTIONS[k]} ({UNITS[k]})",
            origin=f"residual/{AXES[k]}",
            time_ranges=shown,
            axis_x=rrb.archetypes.TimeAxis(view_range=shown.range),
            plot_legend=rrb.PlotLegend(visible=legend and k == 0),
        )
        for k in order
    ]
    return rrb.Grid(*panels, grid_columns=2 if order[1] == 3 else 3, name=name)


def _with_panels(
    content: rrb.Container, timeline: str, state: Literal["paused", "following"] = "paused"
) -> rrb.Blueprint:
    return rrb.Blueprint(
        content,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=timeline, play_state=state),
        auto_views=False,
    )
