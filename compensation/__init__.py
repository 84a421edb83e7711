"""What a moving treadmill adds to its own force plates, and how to remove it again."""

from compensation.accuracy.errors import (
    Line as Line,
)
from compensation.accuracy.errors import (
    Linearity as Linearity,
)
from compensation.accuracy.errors import (
    fit_line_orthogonal as fit_line_orthogonal,
)
from compensation.accuracy.errors import (
    linearity as linearity,
)
from compensation.accuracy.errors import (
    mean_by_level as mean_by_level,
)
from compensation.accuracy.errors import (
    rms_difference as rms_difference,
)
from compensation.accuracy.errors import (
    rms_orthogonal as rms_orthogonal,
)
from compensation.accuracy.plate_calibration import (
    PlateCalibration as PlateCalibration,
)
from compensation.accuracy.plate_calibration import (
    PlateCalibrations as PlateCalibrations,
)
from compensation.accuracy.weight import wrench_of_weight as wrench_of_weight
from compensation.alignment.agreement import (
    AgreedDelay as AgreedDelay,
)
from compensation.alignment.agreement import (
    agreed_delay as agreed_delay,
)
from compensation.alignment.delay import (
    Delay as Delay,
)
from compensation.alignment.delay import (
    estimate_delay as estimate_delay,
)
from compensation.alignment.delay import (
    undo_delay as undo_delay,
)
from compensation.alignment.force_delay import marker_plate_delay as marker_plate_delay
from compensation.alignment.hammer import (
    HammerImpact as HammerImpact,
)
from compensation.alignment.hammer import (
    hammer_delay as hammer_delay,
)
from compensation.alignment.hammer import (
    hammer_impacts as hammer_impacts,
)
from compensation.alignment.plate import (
    PlateAlignment as PlateAlignment,
)
from compensation.alignment.plate import (
    fit_plate_alignment as fit_plate_alignment,
)
from compensation.belt.cutoff import (
    cutoff_of_spline as cutoff_of_spline,
)
from compensation.belt.cutoff import (
    spline_smoothing as spline_smoothing,
)
from compensation.belt.model import (
    BeltModel as BeltModel,
)
from compensation.belt.model import (
    belt_acceleration as belt_acceleration,
)
from compensation.belt.model import (
    fit_belt as fit_belt,
)
from compensation.belt.roller import Roller as Roller
from compensation.belt.roller import fit_roller as fit_roller
from compensation.inertia.calibration import (
    Calibration as Calibration,
)
from compensation.inertia.calibration import (
    from_json as from_json,
)
from compensation.inertia.calibration import (
    to_json as to_json,
)
from compensation.inertia.fit import (
    dynamic_channels as dynamic_channels,
)
from compensation.inertia.fit import (
    fit_inertia as fit_inertia,
)
from compensation.inertia.fit import (
    fit_trials as fit_trials,
)
from compensation.inertia.model import InertiaModel as InertiaModel
from compensation.inertia.model import Setup as Setup
from compensation.inertia.quality import (
    check_calibration as check_calibration,
)
from compensation.inertia.quality import (
    left_over as left_over,
)
from compensation.inertia.quality import (
    refuse_unusable as refuse_unusable,
)
from compensation.inertia.sensors import (
    Sensor as Sensor,
)
from compensation.inertia.sensors import (
    check_trial as check_trial,
)
from compensation.inertia.sensors import (
    find_sensors as find_sensors,
)
from compensation.inertia.sensors import (
    sensor_noise_of as sensor_noise_of,
)
from compensation.platform.markers import (
    PoseFit as PoseFit,
)
from compensation.platform.markers import (
    check_pose as check_pose,
)
from compensation.platform.markers import (
    fit_pose as fit_pose,
)
from compensation.platform.markers import (
    neutral_markers as neutral_markers,
)
from compensation.platform.pose import (
    PlatformPose as PlatformPose,
)
from compensation.platform.pose import (
    commanded_pose as commanded_pose,
)
from compensation.platform.pose import (
    interpolate_pose as interpolate_pose,
)
from compensation.platform.pose import (
    mean_pose as mean_pose,
)
from compensation.platform.pose import (
    pose_delay as pose_delay,
)
from compensation.platform.pose import (
    specific_force as specific_force,
)
from compensation.platform.wrench import (
    center_of_pressure as center_of_pressure,
)
from compensation.platform.wrench import (
    free_moment as free_moment,
)
from compensation.platform.wrench import (
    moment_error_of_pivot as moment_error_of_pivot,
)
from compensation.platform.wrench import (
    to_lab as to_lab,
)
from compensation.signals.protocol import (
    belt_signals as belt_signals,
)
from compensation.signals.protocol import (
    pitch_and_sway_signals as pitch_and_sway_signals,
)
from compensation.signals.signal import (
    MachineLimits as MachineLimits,
)
from compensation.signals.signal import (
    Signal as Signal,
)
from compensation.signals.signal import (
    Spectrum as Spectrum,
)
from compensation.signals.signal import (
    acceleration_spectrum as acceleration_spectrum,
)
from compensation.signals.signal import (
    check_signal as check_signal,
)
from compensation.signals.signal import (
    resample_signal as resample_signal,
)
from compensation.signals.validation import validation_signals as validation_signals
from hbm.signals.filtering import low_pass as low_pass
