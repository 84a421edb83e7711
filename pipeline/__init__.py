"""One study: files, recordings, results, tables, statistics, pictures."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pipeline.c3d import read_c3d
    from pipeline.files import read_recording
    from pipeline.opensim_trial import read_opensim_trial
    from pipeline.process import process_recording, process_trial
    from pipeline.recording import Recording
    from pipeline.residuals import residual_table
    from pipeline.study import Settings, Study, Subject, read_study
    from pipeline.trc import read_trc
    from pipeline.trial_result import TrialResult

_HOME = {
    "read_c3d": "c3d",
    "read_opensim_trial": "opensim_trial",
    "read_recording": "files",
    "TrialResult": "trial_result",
    "process_recording": "process",
    "process_trial": "process",
    "Recording": "recording",
    "residual_table": "residuals",
    "Settings": "study",
    "Study": "study",
    "Subject": "study",
    "read_study": "study",
    "read_trc": "trc",
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
