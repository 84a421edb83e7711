"""What a moving treadmill adds to its own force plates, and how to remove it again."""

from compensation.accuracy import (
    Linearity,
    PlateAlignment,
    fit_plate_alignment,
    linearity,
    orthogonal_rmse,
    wrench_of_weight,
)
from compensation.belts import BeltModel, belt_acceleration, fit_belt, spline_cutoff
from compensation.delay import Delay, estimate_delay
from compensation.force_delay import marker_plate_delay
from compensation.hammer import agreed_delay, hammer_delay
from compensation.inertia.calibration import Calibration, from_json, to_json
from compensation.inertia.fit import dynamic_channels, fit_inertia, fit_trials
from compensation.inertia.model import InertiaModel, Setup
from compensation.inertia.quality import refuse_unusable
from compensation.inertia.sensors import Sensor, check_trial, find_sensors
from compensation.plate_calibration import PlateCalibration, PlateCalibrations
from compensation.platform import (
    PlatformPose,
    center_of_pressure,
    check_pose,
    commanded_pose,
    fit_pose,
    interpolate_pose,
    neutral_markers,
    pose_delay,
    specific_force,
    to_lab,
)
from compensation.protocol import belt_signals, pitch_and_sway_signals, validation_signals
from compensation.signals import (
    MachineLimits,
    Signal,
    acceleration_spectrum,
    check_signal,
    resample_signal,
)
from hbm.signals.filtering import low_pass
