"""All that a script needs, under one name: ``import hbm_residuals as hr``.

The names are those of `pipeline`, where their documentation is. A user's own file ``pipeline.py``
does not hide them.
"""

import sys
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING


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

if TYPE_CHECKING:
    import pipeline.figures.residuals
    import pipeline.io.read
    import pipeline.report.trial_page
    import pipeline.report.write
    import pipeline.run.run
    import pipeline.run.store
    import pipeline.trial.joints
    import pipeline.trial.process
    import pipeline.trial.residuals
    import pipeline.viewer.trial
    from pipeline import virtual_lab as virtual_lab
    from pipeline.budgets.explanation import explain as explain
    from pipeline.config.schema import Condition as Condition
    from pipeline.config.schema import Platform as Platform
    from pipeline.config.schema import Settings as Settings
    from pipeline.config.schema import Subject as Subject
    from pipeline.config.schema import Treadmill as Treadmill
    from pipeline.config.study import read_study as read_study
    from pipeline.live.session import rehearse as rehearse
    from pipeline.trial.ground.calibrations import fit_calibration as fit_calibration
    from pipeline.trial.ground.calibrations import plate_samples as plate_samples
    from pipeline.trial.ground.calibrations import read_calibration as read_calibration
    from pipeline.trial.ground.laboratory import Laboratory as Laboratory

    cycles = pipeline.trial.residuals.cycle_residuals
    figure = pipeline.figures.residuals.residual_figure
    joints = pipeline.trial.joints.joint_curves
    process = pipeline.trial.process.process_recording
    read = pipeline.io.read.read_recording
    read_result = pipeline.run.store.read_trial
    report = pipeline.report.write.write_report
    residuals = pipeline.trial.residuals.residual_table
    run = pipeline.run.run.run_study
    thresholds = pipeline.trial.residuals.threshold_table
    view = pipeline.viewer.trial.view_result
    write_page = pipeline.report.trial_page.write_trial_page
else:
    from hbm.public_names import on_first_use

    __getattr__, __dir__, __all__ = on_first_use(__name__, __file__)
