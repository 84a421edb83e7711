"""What a moving treadmill adds to its own force plates, and how to remove it again."""

from compensation.accuracy.errors import (
    Line as Line,
    Linearity as Linearity,
    fit_line_orthogonal as fit_line_orthogonal,
    linearity as linearity,
    mean_by_level as mean_by_level,
    rms_difference as rms_difference,
    rms_orthogonal as rms_orthogonal,
)
from compensation.accuracy.plate_calibration import (
    PlateCalibration as PlateCalibration,
    PlateCalibrations as PlateCalibrations,
)
from compensation.accuracy.weight import wrench_of_weight as wrench_of_weight
from compensation.alignment.agreement import (
    AgreedDelay as AgreedDelay,
    agreed_delay as agreed_delay,
)
from compensation.alignment.delay import (
    Delay as Delay,
    estimate_delay as estimate_delay,
    undo_delay as undo_delay,
)
from compensation.alignment.force_delay import marker_plate_delay as marker_plate_delay
from compensation.alignment.hammer import (
    HammerImpact as HammerImpact,
    hammer_delay as hammer_delay,
    hammer_impacts as hammer_impacts,
)
from compensation.alignment.plate import (
    PlateAlignment as PlateAlignment,
    fit_plate_alignment as fit_plate_alignment,
)
from compensation.belt.cutoff import (
    cutoff_of_spline as cutoff_of_spline,
    spline_smoothing as spline_smoothing,
)
from compensation.belt.model import (
    BeltModel as BeltModel,
    belt_acceleration as belt_acceleration,
    fit_belt as fit_belt,
)
from compensation.belt.roller import Roller as Roller, fit_roller as fit_roller
from compensation.inertia.calibration import (
    Calibration as Calibration,
    from_json as from_json,
    to_json as to_json,
)
from compensation.inertia.fit import (
    dynamic_channels as dynamic_channels,
    fit_inertia as fit_inertia,
    fit_trials as fit_trials,
)
from compensation.inertia.model import InertiaModel as InertiaModel, Setup as Setup
from compensation.inertia.quality import (
    check_calibration as check_calibration,
    left_over as left_over,
    refuse_unusable as refuse_unusable,
)
from compensation.inertia.sensors import (
    Sensor as Sensor,
    check_trial as check_trial,
    find_sensors as find_sensors,
    sensor_noise_of as sensor_noise_of,
)
from compensation.platform.markers import (
    PoseFit as PoseFit,
    check_pose as check_pose,
    fit_pose as fit_pose,
    neutral_markers as neutral_markers,
)
from compensation.platform.pose import (
    PlatformPose as PlatformPose,
    commanded_pose as commanded_pose,
    interpolate_pose as interpolate_pose,
    mean_pose as mean_pose,
    pose_delay as pose_delay,
    specific_force as specific_force,
)
from compensation.platform.wrench import (
    center_of_pressure as center_of_pressure,
    free_moment as free_moment,
    moment_error_of_pivot as moment_error_of_pivot,
    to_lab as to_lab,
)
from compensation.signals.protocol import (
    belt_signals as belt_signals,
    pitch_and_sway_signals as pitch_and_sway_signals,
)
from compensation.signals.signal import (
    MachineLimits as MachineLimits,
    Signal as Signal,
    Spectrum as Spectrum,
    acceleration_spectrum as acceleration_spectrum,
    check_signal as check_signal,
    resample_signal as resample_signal,
)
from compensation.signals.validation import validation_signals as validation_signals
from hbm.signals.filtering import low_pass as low_pass
