"""One study: files, recordings, results, tables, statistics, figures."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pipeline.config.schema import Settings, Subject
    from pipeline.config.study import Study, read_study
    from pipeline.io.c3d.read import read_c3d
    from pipeline.io.opensim.trc import read_trc
    from pipeline.io.opensim.trial import read_opensim_trial
    from pipeline.io.read import read_recording
    from pipeline.io.recording import Recording
    from pipeline.trial.process import process_recording, process_trial
    from pipeline.trial.residuals import residual_table
    from pipeline.trial.result import TrialResult

_HOME = {
    "read_c3d": "io.c3d.read",
    "read_opensim_trial": "io.opensim.trial",
    "read_recording": "io.read",
    "TrialResult": "trial.result",
    "process_recording": "trial.process",
    "process_trial": "trial.process",
    "Recording": "io.recording",
    "residual_table": "trial.residuals",
    "Settings": "config.schema",
    "Study": "config.study",
    "Subject": "config.schema",
    "read_study": "config.study",
    "read_trc": "io.opensim.trc",
}

__all__ = [
    "Recording",
    "Settings",
    "Study",
    "Subject",
    "TrialResult",
    "process_recording",
    "process_trial",
    "read_c3d",
    "read_opensim_trial",
    "read_recording",
    "read_study",
    "read_trc",
    "residual_table",
]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used, so that importing the package costs nothing."""
    if name not in _HOME:
        raise AttributeError(f"module 'pipeline' has no attribute {name!r}")
    return getattr(import_module(f"pipeline.{_HOME[name]}"), name)
