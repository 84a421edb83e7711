"""One study: files, recordings, results, tables, statistics, figures."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pipeline.config.schema import Condition, Platform, Settings, Subject, Treadmill
    from pipeline.config.study import Study, read_study
    from pipeline.io.c3d.read import read_c3d
    from pipeline.io.read import read_recording
    from pipeline.io.recording import Recording
    from pipeline.io.stated import Stated
    from pipeline.report.write import write_report
    from pipeline.run.run import run_study
    from pipeline.run.store import read_trial
    from pipeline.trial.ground.calibrations import read_calibration
    from pipeline.trial.ground.laboratory import Laboratory
    from pipeline.trial.process import process_recording, process_trial
    from pipeline.trial.residuals import residual_table
    from pipeline.trial.result import TrialResult

_HOME = {
    "Condition": "config.schema",
    "Laboratory": "trial.ground.laboratory",
    "Platform": "config.schema",
    "Recording": "io.recording",
    "Settings": "config.schema",
    "Stated": "io.stated",
    "Study": "config.study",
    "Subject": "config.schema",
    "Treadmill": "config.schema",
    "TrialResult": "trial.result",
    "process_recording": "trial.process",
    "process_trial": "trial.process",
    "read_c3d": "io.c3d.read",
    "read_calibration": "trial.ground.calibrations",
    "read_recording": "io.read",
    "read_study": "config.study",
    "read_trial": "run.store",
    "residual_table": "trial.residuals",
    "run_study": "run.run",
    "write_report": "report.write",
}

__all__ = [
    "Condition",
    "Laboratory",
    "Platform",
    "Recording",
    "Settings",
    "Stated",
    "Study",
    "Subject",
    "Treadmill",
    "TrialResult",
    "process_recording",
    "process_trial",
    "read_c3d",
    "read_calibration",
    "read_recording",
    "read_study",
    "read_trial",
    "residual_table",
    "run_study",
    "write_report",
]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used, so that importing the package costs nothing."""
    if name not in _HOME:
        raise AttributeError(f"module 'pipeline' has no attribute {name!r}")
    return getattr(import_module(f"pipeline.{_HOME[name]}"), name)
