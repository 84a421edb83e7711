"""All that a script needs: ``import hbm_residuals as hr``.

One trial
    read(file)                a recording: markers, plates, channels, events
    Subject, Settings         of whom, and how it is processed
    Condition                 which gait cycles count, or which span
    process(recording, ...)   result: motion, joint moments, residuals
    residuals(result, name)   table: RMS, mean, SD and peak of each residual
    thresholds(result)        table: peaks beside published limits
    cycles(result, variant)   residuals of every gait cycle, 0 to 100 %
    joints(result)            joint angles, moments and powers, 0 to 100 %
    figure(result)            forces on the feet and residuals over time
    view(result)              the trial in the viewer
    write_page(result, file)  all of it as one HTML page
    explain(recording, ...)   causes of the residuals, and how sure they are
    rehearse(recording, ...)  the recording through the live chain
A study
    read_study(folder)        subjects, conditions, settings
    run(study, folder)        process all trials; finished ones are kept
    read_result(file)         the result of one trial
    report(folder)            tables, statistics, figures, report.html
A treadmill that moves
    Treadmill, Platform       its accelerometers, and how its pose is known
    fit_calibration(...)      a calibration from the empty, moving treadmill
    read_calibration(file)    one that was fitted before
    plate_samples(...)        samples that calibrations are fitted to
    Laboratory                all that compensates the plates of a trial
    virtual_lab               simulated recordings with known truth
More of each: help(hr.process). Examples: docs/python.md.
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

    # without __all__, help() shows the list above, not the code of all names
    __getattr__, __dir__, _ = on_first_use(__name__, __file__)
