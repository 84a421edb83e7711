"""A simulated laboratory: people who walk on a moving, instrumented treadmill, and the truth.

What a script needs of it is ``virtual_lab`` of `hbm_residuals`.
"""

from compensation.protocol import pitch_and_sway_signals, validation_signals
from compensation.signals import Signal
from pipeline.virtual_lab.faults import AccelerometerFaults, Faults
from pipeline.virtual_lab.protocol.calibration_trial import record_signal_trial
from pipeline.virtual_lab.protocol.walking_protocol import PERSONS, Protocol, Setting
from pipeline.virtual_lab.protocol.walking_study import simulate_study
from pipeline.virtual_lab.protocol.walking_trial import simulate_trial

__all__ = [
    "PERSONS",
    "AccelerometerFaults",
    "Faults",
    "Protocol",
    "Setting",
    "Signal",
    "pitch_and_sway_signals",
    "record_signal_trial",
    "simulate_study",
    "simulate_trial",
    "validation_signals",
]
