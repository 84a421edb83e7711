"""One study: files, recordings, results, tables, statistics, figures."""

from typing import TYPE_CHECKING

from hbm.public_names import on_first_use

if TYPE_CHECKING:
    from pipeline.config.schema import Condition as Condition
    from pipeline.config.schema import Platform as Platform
    from pipeline.config.schema import Settings as Settings
    from pipeline.config.schema import Subject as Subject
    from pipeline.config.schema import Treadmill as Treadmill
    from pipeline.config.study import Study as Study
    from pipeline.config.study import read_study as read_study
    from pipeline.io.c3d.read import read_c3d as read_c3d
    from pipeline.io.read import read_recording as read_recording
    from pipeline.io.read_options import ReadOptions as ReadOptions
    from pipeline.io.recording import Recording as Recording
    from pipeline.report.write import write_report as write_report
    from pipeline.run.run import run_study as run_study
    from pipeline.run.store import read_trial as read_trial
    from pipeline.trial.ground.calibrations import read_calibration as read_calibration
    from pipeline.trial.ground.laboratory import Laboratory as Laboratory
    from pipeline.trial.process import process_recording as process_recording
    from pipeline.trial.process import process_trial as process_trial
    from pipeline.trial.residuals import residual_table as residual_table
    from pipeline.trial.result import TrialResult as TrialResult
else:
    __getattr__, __dir__, __all__ = on_first_use(__name__, __file__)
