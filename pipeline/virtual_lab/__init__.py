"""A simulated laboratory: people who walk on a moving, instrumented treadmill, and the truth.

What a script needs of it is ``virtual_lab`` of `hbm_residuals`:

    simulate_trial(file, ...)      one walking trial
    simulate_study(folder, ...)    a study; Protocol, PERSONS: who walks how
    record_signal_trial(signal)    the empty treadmill while it follows a Signal
    pitch_and_sway_signals(...)    signals for calibrations
    validation_signals(...)        and for checking them
    Setting                        protocol, seed and Faults of a simulation
    AccelerometerFaults            of its accelerometers
"""

from compensation.protocol import pitch_and_sway_signals as pitch_and_sway_signals
from compensation.protocol import validation_signals as validation_signals
from compensation.signals import Signal as Signal
from pipeline.virtual_lab.faults import AccelerometerFaults as AccelerometerFaults
from pipeline.virtual_lab.faults import Faults as Faults
from pipeline.virtual_lab.protocol.calibration_trial import (
    record_signal_trial as record_signal_trial,
)
from pipeline.virtual_lab.protocol.walking_protocol import PERSONS as PERSONS
from pipeline.virtual_lab.protocol.walking_protocol import Protocol as Protocol
from pipeline.virtual_lab.protocol.walking_protocol import Setting as Setting
from pipeline.virtual_lab.protocol.walking_study import simulate_study as simulate_study
from pipeline.virtual_lab.protocol.walking_trial import simulate_trial as simulate_trial
