"""What a moving treadmill adds to its own force plates, and how to remove it again."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from compensation.accuracy.errors import (
        Line,
        Linearity,
        fit_line_orthogonal,
        linearity,
        mean_by_level,
        rms_difference,
        rms_orthogonal,
    )
    from compensation.accuracy.plate_calibration import PlateCalibration, PlateCalibrations
    from compensation.accuracy.weight import wrench_of_weight
    from compensation.alignment.agreement import AgreedDelay, agreed_delay
    from compensation.alignment.delay import Delay, estimate_delay, undo_delay
    from compensation.alignment.force_delay import marker_plate_delay
    from compensation.alignment.hammer import HammerImpact, hammer_delay, hammer_impacts
    from compensation.alignment.plate import PlateAlignment, fit_plate_alignment
    from compensation.belt.cutoff import cutoff_of_spline, spline_smoothing
    from compensation.belt.model import BeltModel, belt_acceleration, fit_belt
    from compensation.belt.roller import Roller, fit_roller
    from compensation.inertia.calibration import Calibration, from_json, to_json
    from compensation.inertia.checks import check_calibration, check_trial
    from compensation.inertia.dynamic import dynamic_channels, fit_dynamic
    from compensation.inertia.fit import fit_inertia, fit_trials, sensor_noise_of
    from compensation.inertia.model import InertiaModel, Setup
    from compensation.inertia.places import best_places
    from compensation.inertia.quality import left_over, refuse_unusable
    from compensation.inertia.sensors import Sensor, find_sensors
    from compensation.platform.markers import PoseFit, check_pose, fit_pose, neutral_markers
    from compensation.platform.pose import (
        PlatformPose,
        commanded_pose,
        interpolate_pose,
        mean_pose,
        pose_delay,
        specific_force,
    )
    from compensation.platform.wrench import (
        center_of_pressure,
        free_moment,
        moment_error_of_pivot,
        to_lab,
    )
    from compensation.signals.protocol import (
        belt_signals,
        pitch_and_sway_signals,
    )
    from compensation.signals.signal import (
        MachineLimits,
        Signal,
        Spectrum,
        acceleration_spectrum,
        check_signal,
        resample_signal,
    )
    from compensation.signals.validation import validation_signals
    from hbm.signals.filtering import low_pass

_HOME = {
    "Line": "compensation.accuracy.errors",
    "Linearity": "compensation.accuracy.errors",
    "fit_line_orthogonal": "compensation.accuracy.errors",
    "linearity": "compensation.accuracy.errors",
    "mean_by_level": "compensation.accuracy.errors",
    "rms_difference": "compensation.accuracy.errors",
    "rms_orthogonal": "compensation.accuracy.errors",
    "PlateCalibration": "compensation.accuracy.plate_calibration",
    "PlateCalibrations": "compensation.accuracy.plate_calibration",
    "wrench_of_weight": "compensation.accuracy.weight",
    "AgreedDelay": "compensation.alignment.agreement",
    "agreed_delay": "compensation.alignment.agreement",
    "Delay": "compensation.alignment.delay",
    "estimate_delay": "compensation.alignment.delay",
    "undo_delay": "compensation.alignment.delay",
    "marker_plate_delay": "compensation.alignment.force_delay",
    "HammerImpact": "compensation.alignment.hammer",
    "hammer_delay": "compensation.alignment.hammer",
    "hammer_impacts": "compensation.alignment.hammer",
    "PlateAlignment": "compensation.alignment.plate",
    "fit_plate_alignment": "compensation.alignment.plate",
    "cutoff_of_spline": "compensation.belt.cutoff",
    "spline_smoothing": "compensation.belt.cutoff",
    "BeltModel": "compensation.belt.model",
    "belt_acceleration": "compensation.belt.model",
    "fit_belt": "compensation.belt.model",
    "Roller": "compensation.belt.roller",
    "fit_roller": "compensation.belt.roller",
    "Calibration": "compensation.inertia.calibration",
    "from_json": "compensation.inertia.calibration",
    "to_json": "compensation.inertia.calibration",
    "check_calibration": "compensation.inertia.checks",
    "check_trial": "compensation.inertia.checks",
    "dynamic_channels": "compensation.inertia.dynamic",
    "fit_dynamic": "compensation.inertia.dynamic",
    "fit_inertia": "compensation.inertia.fit",
    "fit_trials": "compensation.inertia.fit",
    "sensor_noise_of": "compensation.inertia.fit",
    "InertiaModel": "compensation.inertia.model",
    "best_places": "compensation.inertia.places",
    "left_over": "compensation.inertia.quality",
    "refuse_unusable": "compensation.inertia.quality",
    "Sensor": "compensation.inertia.sensors",
    "find_sensors": "compensation.inertia.sensors",
    "Setup": "compensation.inertia.model",
    "PoseFit": "compensation.platform.markers",
    "check_pose": "compensation.platform.markers",
    "fit_pose": "compensation.platform.markers",
    "neutral_markers": "compensation.platform.markers",
    "PlatformPose": "compensation.platform.pose",
    "commanded_pose": "compensation.platform.pose",
    "interpolate_pose": "compensation.platform.pose",
    "mean_pose": "compensation.platform.pose",
    "pose_delay": "compensation.platform.pose",
    "specific_force": "compensation.platform.pose",
    "center_of_pressure": "compensation.platform.wrench",
    "free_moment": "compensation.platform.wrench",
    "moment_error_of_pivot": "compensation.platform.wrench",
    "to_lab": "compensation.platform.wrench",
    "belt_signals": "compensation.signals.protocol",
    "pitch_and_sway_signals": "compensation.signals.protocol",
    "validation_signals": "compensation.signals.validation",
    "MachineLimits": "compensation.signals.signal",
    "Signal": "compensation.signals.signal",
    "Spectrum": "compensation.signals.signal",
    "acceleration_spectrum": "compensation.signals.signal",
    "check_signal": "compensation.signals.signal",
    "resample_signal": "compensation.signals.signal",
    "low_pass": "hbm.signals.filtering",
}
"""Public name -> the module that defines it."""

__all__ = [
    "AgreedDelay",
    "BeltModel",
    "Calibration",
    "Delay",
    "HammerImpact",
    "InertiaModel",
    "Line",
    "Linearity",
    "MachineLimits",
    "PlateAlignment",
    "PlateCalibration",
    "PlateCalibrations",
    "PlatformPose",
    "PoseFit",
    "Roller",
    "Sensor",
    "Setup",
    "Signal",
    "Spectrum",
    "acceleration_spectrum",
    "agreed_delay",
    "belt_acceleration",
    "belt_signals",
    "best_places",
    "center_of_pressure",
    "check_calibration",
    "check_pose",
    "check_signal",
    "check_trial",
    "commanded_pose",
    "cutoff_of_spline",
    "dynamic_channels",
    "estimate_delay",
    "find_sensors",
    "fit_belt",
    "fit_dynamic",
    "fit_inertia",
    "fit_line_orthogonal",
    "fit_plate_alignment",
    "fit_pose",
    "fit_roller",
    "fit_trials",
    "free_moment",
    "from_json",
    "hammer_delay",
    "hammer_impacts",
    "interpolate_pose",
    "left_over",
    "linearity",
    "low_pass",
    "marker_plate_delay",
    "mean_by_level",
    "mean_pose",
    "moment_error_of_pivot",
    "neutral_markers",
    "pitch_and_sway_signals",
    "pose_delay",
    "refuse_unusable",
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
    return getattr(import_module(_HOME[name]), name)
