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
    from compensation.alignment import Delay, estimate_delay, hammer_delay, undo_delay
    from compensation.belt import BeltModel, belt_acceleration, fit_belt, low_pass
    from compensation.calibration import Calibration, from_json, to_json
    from compensation.cutoff import cutoff_of_spline, spline_smoothing
    from compensation.inertia import InertiaModel, Setup
    from compensation.inertia_fit import fit_inertia, sensor_noise_of
    from compensation.plate_calibration import PlateCalibration, fit_plate_calibration
    from compensation.platform import (
        PlatformPose,
        center_of_pressure,
        commanded_pose,
        free_moment,
        moment_error_of_pivot,
        pose_delay,
        specific_force,
        to_lab,
    )
    from compensation.platform_markers import PoseFit, check_pose, fit_pose, neutral_markers
    from compensation.protocol import belt_signals, pitch_and_sway_signals, validation_signals
    from compensation.roller import Roller, fit_roller
    from compensation.sensors import check_calibration, check_trial
    from compensation.signals import (
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
    "Delay": "alignment",
    "estimate_delay": "alignment",
    "hammer_delay": "alignment",
    "undo_delay": "alignment",
    "BeltModel": "belt",
    "belt_acceleration": "belt",
    "fit_belt": "belt",
    "low_pass": "belt",
    "Calibration": "calibration",
    "from_json": "calibration",
    "to_json": "calibration",
    "cutoff_of_spline": "cutoff",
    "spline_smoothing": "cutoff",
    "InertiaModel": "inertia",
    "Setup": "inertia",
    "fit_inertia": "inertia_fit",
    "sensor_noise_of": "inertia_fit",
    "PlateCalibration": "plate_calibration",
    "fit_plate_calibration": "plate_calibration",
    "PlatformPose": "platform",
    "center_of_pressure": "platform",
    "commanded_pose": "platform",
    "free_moment": "platform",
    "moment_error_of_pivot": "platform",
    "pose_delay": "platform",
    "specific_force": "platform",
    "to_lab": "platform",
    "PoseFit": "platform_markers",
    "check_pose": "platform_markers",
    "fit_pose": "platform_markers",
    "neutral_markers": "platform_markers",
    "belt_signals": "protocol",
    "pitch_and_sway_signals": "protocol",
    "validation_signals": "protocol",
    "Roller": "roller",
    "fit_roller": "roller",
    "check_calibration": "sensors",
    "check_trial": "sensors",
    "Limits": "signals",
    "Signal": "signals",
    "Spectrum": "signals",
    "acceleration_spectrum": "signals",
    "check_signal": "signals",
    "resample_signal": "signals",
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
