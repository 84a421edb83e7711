"""All that a script needs, under one name: ``import hbm_residuals as hr``.

The names are those of `pipeline`, where their documentation is. A user's own file ``pipeline.py``
does not hide them.
"""

import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from pipeline import virtual_lab as virtual_lab
    from pipeline.budgets.explanation import explain as explain
    from pipeline.config.schema import Condition as Condition
    from pipeline.config.schema import Platform as Platform
    from pipeline.config.schema import Settings as Settings
    from pipeline.config.schema import Subject as Subject
    from pipeline.config.schema import Treadmill as Treadmill
    from pipeline.config.study import read_study as read_study
    from pipeline.figures.residuals import residual_figure as figure
    from pipeline.io.read import read_recording as read
    from pipeline.live.session import rehearse as rehearse
    from pipeline.report.trial_page import write_trial_page as write_page
    from pipeline.report.write import write_report as report
    from pipeline.run.run import run_study as run
    from pipeline.run.store import read_trial as read_result
    from pipeline.trial.ground.calibration_recording import fit_calibration as fit_calibration
    from pipeline.trial.ground.calibration_recording import plate_samples as plate_samples
    from pipeline.trial.ground.calibrations import read_calibration as read_calibration
    from pipeline.trial.ground.laboratory import Laboratory as Laboratory
    from pipeline.trial.joints import joint_curves as joints
    from pipeline.trial.process import process_recording as process
    from pipeline.trial.residuals import cycle_residuals as cycles
    from pipeline.trial.residuals import residual_table as residuals
    from pipeline.trial.residuals import threshold_table as thresholds
    from pipeline.viewer.trial import view_result as view

_HOME: Final = {
    "Condition": "config.schema:Condition",
    "Laboratory": "trial.ground.laboratory:Laboratory",
    "Platform": "config.schema:Platform",
    "Settings": "config.schema:Settings",
    "Subject": "config.schema:Subject",
    "Treadmill": "config.schema:Treadmill",
    "cycles": "trial.residuals:cycle_residuals",
    "explain": "budgets.explanation:explain",
    "figure": "figures.residuals:residual_figure",
    "fit_calibration": "trial.ground.calibration_recording:fit_calibration",
    "joints": "trial.joints:joint_curves",
    "plate_samples": "trial.ground.calibration_recording:plate_samples",
    "process": "trial.process:process_recording",
    "read": "io.read:read_recording",
    "read_calibration": "trial.ground.calibrations:read_calibration",
    "read_result": "run.store:read_trial",
    "read_study": "config.study:read_study",
    "rehearse": "live.session:rehearse",
    "report": "report.write:write_report",
    "residuals": "trial.residuals:residual_table",
    "run": "run.run:run_study",
    "thresholds": "trial.residuals:threshold_table",
    "view": "viewer.trial:view_result",
    "virtual_lab": "virtual_lab",
    "write_page": "report.trial_page:write_trial_page",
}
"""Name -> module of ``pipeline``, and its name there, if it is not the module itself."""
__all__ = sorted(_HOME)


def _find_own_packages() -> None:
    """Find the packages beside this one even where a script's folder has files of their names.

    An ImportError if such a file has been imported already.
    """
    folder = Path(__file__).resolve().parent.parent
    for name in ("hbm", "compensation", "pipeline"):
        loaded = sys.modules.get(name)
        origin = loaded.__file__ if loaded else getattr(find_spec(name), "origin", None)
        if Path(origin or "").resolve().parent.parent == folder:
            continue
        if loaded is not None:
            raise ImportError(
                f"{origin} has been imported as {name!r}, a package of hbm-residuals; import "
                "hbm_residuals first, or rename that file"
            )
        sys.path.insert(0, str(folder))  # of processes that this one starts, too
        return


_find_own_packages()


def __dir__() -> list[str]:
    """List the public names, for those who explore them."""
    return __all__


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used, so that importing the package costs nothing."""
    if name not in _HOME:
        raise AttributeError(f"module 'hbm_residuals' has no attribute {name!r}")
    path, _, name = _HOME[name].partition(":")
    module = import_module(f"pipeline.{path}")
    return getattr(module, name) if name else module
