"""What is where when a recording is opened, and what its shapes and colours mean."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from hbm.spatial import Array
from pipeline.figures.joints import LEG
from pipeline.trial.residuals import AXES
from pipeline.viewer.board import SENT, WHITE
from pipeline.viewer.file import Stream, rgba
from pipeline.viewer.live import FULL_SCALE
from pipeline.viewer.plots import panel_name
from pipeline.viewer.scene import ARROWS, MIN_ERROR_LINE_M

ROWS: Final = "left_foot", "right_foot", "perturbation", "plates", "residuals"
"""Of states over time: the viewer shows names of entities."""
CYCLE: Final = "gait cycle"
"""Timeline whose steps are gait cycles, each shown where it stands out, with its RMS residuals."""
PERCENT: Final = "gait cycle, %"
"""Timeline of trials side by side: 1235 is 35 % of the 12th gait cycle."""


def log_text(stream: Stream, entity: str, text: str) -> None:
    """Log a text in Markdown that stays."""
    stream.log(entity, rr.TextDocument(text, media_type="text/markdown"), static=True)


def log_legend(stream: Stream) -> None:
    """Log what shapes and colours mean."""
    text = Path(__file__).with_name("legend.md").read_text(encoding="utf-8")
    log_text(stream, "legend", text.format(arrows=ARROWS, far_mm=MIN_ERROR_LINE_M * 1000))


def trial_layout(pelvis: Array, *, video: bool) -> rrb.Blueprint:
    """Lay out a trial around the path of the pelvis, (T, 3) [m]."""
    window = _time(-2.0, 2.0)  # about two gait cycles before and after the cursor
    states = rrb.StateTimelineView(
        name="Gait phases",
        contents=[f"/{row}" for row in ROWS],
        time_view=rrb.archetypes.TimeAxis(view_range=window.range),
    )
    return _with_panels(
        rrb.Horizontal(
            rrb.Vertical(_scene(pelvis), *_videos(video), states, row_shares=[3, *[2] * video, 1]),
            rrb.Tabs(
                _residuals("Residuals around the cursor", window),
                _residuals("Residuals, whole trial", None),
                _panels(
                    "Joint moments",
                    {
                        f"{motion.joint} {motion.direction} (N·m/kg)": f"joints/{motion.name}"
                        for motion in LEG
                    },
                    window,
                ),
                _series("Marker errors (mm)", "marker_error_mm", None),
            ),
            rrb.Tabs(_text("summary"), _text("legend")),
            column_shares=[5, 10, 5],
        )
    )


def beside_layout(
    paths: Mapping[str, Array], scales: Sequence[float], *, video: bool
) -> rrb.Blueprint:
    """Lay out trials, title -> path of the pelvis, side by side on the same scales [N, N·m]."""
    window = _time(-200, 200, PERCENT)  # two gait cycles before and after the cursor
    columns = [
        rrb.Vertical(
            _scene(pelvis, f"trial_{k}/", title),
            _residuals(title, window, 2, scales, f"trial_{k}/"),
            row_shares=[4, 5],
        )
        for k, (title, pelvis) in enumerate(paths.items())
    ]
    return _with_panels(rrb.Horizontal(*columns, *_videos(video)), timeline=PERCENT)


def live_layout(target: Array, *, light: bool) -> rrb.Blueprint:
    """Lay out a live view, whose camera looks at a point, (3,) [m]; its scales are fixed."""
    window, (width, height) = _time(-10.0, 0.0), SENT  # about nine gait cycles
    board = rrb.Spatial2DView(
        name="Light",
        origin="board",
        visual_bounds=rrb.VisualBounds2D(x_range=[0, width], y_range=[0, height]),
        background=rgba(WHITE)[0],
    )
    walking = rrb.Vertical(
        _scene(target[None]),
        rrb.Tabs(
            _residuals("The last seconds", window, columns=3, scales=FULL_SCALE),
            _text("legend"),
        ),
        row_shares=[3, 2],
    )
    return _with_panels(rrb.Horizontal(walking, *[board] * light), state="following")


def _time(start: float, stop: float, timeline: str = "time") -> rrb.VisibleTimeRange:
    """Show from one time to another after the cursor [s, or %]."""
    unit = "seconds" if timeline == "time" else "seq"
    first, last = (rrb.TimeRangeBoundary.cursor_relative(**{unit: at}) for at in (start, stop))
    return rrb.VisibleTimeRange(timeline, start=first, end=last)


def _videos(there: bool) -> list[rrb.View]:
    return [rrb.Spatial2DView(name="Video", origin="video")] if there else []


def _text(entity: str) -> rrb.TextDocumentView:
    return rrb.TextDocumentView(name=entity.capitalize(), origin=entity)


def _series(
    name: str, origin: str, shown: rrb.VisibleTimeRange | None, **more: Any
) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(name=name, origin=origin, time_ranges=shown, **more)


def _scene(pelvis: Array, folder: str = "", name: str = "Body and forces") -> rrb.Spatial3DView:
    middle = np.nanmedian(pelvis, axis=0)
    path = float(np.max(np.nanmax(pelvis, axis=0) - np.nanmin(pelvis, axis=0)))
    # from ahead of the subject, from the right, slightly above the pelvis; twice as far away where
    # the pelvis travels 2.5 m, and so on in proportion
    eye = middle + (1 + path / 2.5) * np.array([1.5, -1.9, 0.35])
    return rrb.Spatial3DView(
        name=name,
        origin=f"{folder}lab",
        line_grid=rrb.LineGrid3D(visible=True, spacing=0.25),
        eye_controls=rrb.EyeControls3D(position=eye, look_target=middle, eye_up=(0, 0, 1)),
    )


def _residuals(
    name: str,
    shown: rrb.VisibleTimeRange | None,
    columns: int = 2,
    scales: Sequence[float] = (),
    folder: str = "",
) -> rrb.Grid:
    """Give six panels: forces left of moments in two columns, above them in three."""
    order = (0, 3, 1, 4, 2, 5) if columns == 2 else range(6)
    entities = {panel_name(k): f"{folder}residual/{AXES[k]}" for k in order}
    return _panels(name, entities, shown, columns, [scales[k] for k in order if len(scales)])


def _panels(
    name: str,
    entities: Mapping[str, str],
    shown: rrb.VisibleTimeRange | None,
    columns: int = 2,
    scales: Sequence[float] = (),
) -> rrb.Grid:
    """Give panels of curves, title -> entity, of fixed scales if any; the first has the legend."""
    panels = [
        _series(
            title,
            entity,
            shown,
            plot_legend=rrb.PlotLegend(visible=k == 0),
            axis_y=rrb.ScalarAxis(range=(-scales[k], scales[k])) if scales else None,
        )
        for k, (title, entity) in enumerate(entities.items())
    ]
    return rrb.Grid(*panels, grid_columns=columns, name=name)


def _with_panels(
    content: rrb.Container,
    state: Literal["paused", "following"] = "paused",
    timeline: str = "time",
) -> rrb.Blueprint:
    return rrb.Blueprint(
        content,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=timeline, play_state=state),
        auto_views=False,
    )
