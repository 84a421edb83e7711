"""What a moving treadmill adds to its own force plates, and how to take it away again."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from compensation.accuracy import (
        Line,
        Linearity,
        fit_line_orthogonal,
        linearity,
        mean_by_level,
        rms_difference,
        rms_orthogonal,
        wrench_of_weight,
    )
    from compensation.alignment.delay import Delay, estimate_delay, hammer_delay, undo_delay
    from compensation.alignment.plate import PlateCalibration, fit_plate_calibration
    from compensation.belt.cutoff import cutoff_of_spline, spline_smoothing
    from compensation.belt.model import BeltModel, belt_acceleration, fit_belt, low_pass
    from compensation.belt.roller import Roller, fit_roller
    from compensation.inertia.calibration import Calibration, from_json, to_json
    from compensation.inertia.checks import check_calibration, check_trial
    from compensation.inertia.fit import fit_inertia, sensor_noise_of
    from compensation.inertia.model import InertiaModel, Setup
    from compensation.platform.markers import PoseFit, check_pose, fit_pose, neutral_markers
    from compensation.platform.pose import (
        PlatformPose,
        center_of_pressure,
        commanded_pose,
        free_moment,
        moment_error_of_pivot,
        pose_delay,
        specific_force,
        to_lab,
    )
    from compensation.signals.protocol import (
        belt_signals,
        pitch_and_sway_signals,
        validation_signals,
    )
    from compensation.signals.signal import (
        Limits,
        Signal,
        Spectrum,
        acceleration_spectrum,
        check_signal,
        resample_signal,
    )

_HOME = {
    "Line": "accuracy",
    "Linearity": "accuracy",
    "fit_line_orthogonal": "accuracy",
    "linearity": "accuracy",
    "mean_by_level": "accuracy",
    "rms_difference": "accuracy",
    "rms_orthogonal": "accuracy",
    "wrench_of_weight": "accuracy",
    "Delay": "alignment.delay",
    "estimate_delay": "alignment.delay",
    "hammer_delay": "alignment.delay",
    "undo_delay": "alignment.delay",
    "BeltModel": "belt.model",
    "belt_acceleration": "belt.model",
    "fit_belt": "belt.model",
    "low_pass": "belt.model",
    "Calibration": "inertia.calibration",
    "from_json": "inertia.calibration",
    "to_json": "inertia.calibration",
    "cutoff_of_spline": "belt.cutoff",
    "spline_smoothing": "belt.cutoff",
    "InertiaModel": "inertia.model",
    "Setup": "inertia.model",
    "fit_inertia": "inertia.fit",
    "sensor_noise_of": "inertia.fit",
    "PlateCalibration": "alignment.plate",
    "fit_plate_calibration": "alignment.plate",
    "PlatformPose": "platform.pose",
    "center_of_pressure": "platform.pose",
    "commanded_pose": "platform.pose",
    "free_moment": "platform.pose",
    "moment_error_of_pivot": "platform.pose",
    "pose_delay": "platform.pose",
    "specific_force": "platform.pose",
    "to_lab": "platform.pose",
    "PoseFit": "platform.markers",
    "check_pose": "platform.markers",
    "fit_pose": "platform.markers",
    "neutral_markers": "platform.markers",
    "belt_signals": "signals.protocol",
    "pitch_and_sway_signals": "signals.protocol",
    "validation_signals": "signals.protocol",
    "Roller": "belt.roller",
    "fit_roller": "belt.roller",
    "check_calibration": "inertia.checks",
    "check_trial": "inertia.checks",
    "Limits": "signals.signal",
    "Signal": "signals.signal",
    "Spectrum": "signals.signal",
    "acceleration_spectrum": "signals.signal",
    "check_signal": "signals.signal",
    "resample_signal": "signals.signal",
}

__all__ = [
    "BeltModel",
    "Calibration",
    "Delay",
    "InertiaModel",
    "Limits",
    "Line",
    "Linearity",
    "PlateCalibration",
    "PlatformPose",
    "PoseFit",
    "Roller",
    "Setup",
    "Signal",
    "Spectrum",
    "acceleration_spectrum",
    "belt_acceleration",
    "belt_signals",
    "center_of_pressure",
    "check_calibration",
    "check_pose",
    "check_signal",
    "check_trial",
    "commanded_pose",
    "cutoff_of_spline",
    "estimate_delay",
    "fit_belt",
    "fit_inertia",
    "fit_line_orthogonal",
    "fit_plate_calibration",
    "fit_pose",
    "fit_roller",
    "free_moment",
    "from_json",
    "hammer_delay",
    "linearity",
    "low_pass",
    "mean_by_level",
    "moment_error_of_pivot",
    "neutral_markers",
    "pitch_and_sway_signals",
    "pose_delay",
    "resample_signal",
    "rms_difference",
    "rms_orthogonal",
    "sensor_noise_of",
    "specific_force",
    "spline_smoothing",
    "to_json",
    "to_lab",
    "undo_delay",
    "validation_signals",
    "wrench_of_weight",
]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used, so that importing the package costs nothing."""
    if name not in _HOME:
        raise AttributeError(f"module 'compensation' has no attribute {name!r}")
    return getattr(import_module(f"compensation.{_HOME[name]}"), name)
