"""What the empty left plate measures while somebody runs on the other belt, by flexibility.

Table II of the thesis has it (row Running, before compensation), so it tells how flexible a machine
was without a cell of Table III.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import pandas as pd

from compensation.protocol import validation_signals
from hbm.signals.filtering import low_pass
from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.instrumented_treadmill import ANALOG_HZ, make_treadmill
from pipeline.virtual_lab.machine.structure import make_structure, state_matrix
from pipeline.virtual_lab.protocol import calibration_trial
from pipeline.virtual_lab.protocol.calibration_trial import record_signal_trial, sample_times
from pipeline.virtual_lab.protocol.walking_study import CUTOFF_HZ

FORCES: Final = ("forward", "left", "up")
THESIS_RUNNING_N: Final = (3.9, 1.9, 7.2)
"""`FORCES` in Table II of the thesis, where they are Fz, Fx and Fy; whether they were filtered is
not stated."""
DURATION_S: Final = 25.0
SETTLING_S: Final = 3.0
TREADMILL_SEED: Final = 1
PERSON_SEED: Final = 2
TRIAL_SEED: Final = 3


def beside_a_runner(structures: Sequence[float]) -> pd.DataFrame:
    """Simulate the thesis' validation trial with a runner on machines of several flexibilities.

    1 is the default. Gives ``flexibility``; ``sway_hz, pitch_hz``, the two lowest natural
    frequencies; ``filtered``, whether below 6 Hz; RMS of ``forward, left, up`` about the mean [N].
    """
    whole = next(signal for signal in validation_signals() if signal.name == "running")
    rows = slice(round(DURATION_S * whole.rate_hz))
    signal = replace(
        whole, sway=whole.sway[rows], pitch=whole.pitch[rows], belt_speed=whole.belt_speed[rows]
    )
    time = sample_times(signal, ANALOG_HZ)
    load = calibration_trial.running(time, np.random.default_rng(PERSON_SEED))
    inside = (time >= SETTLING_S) & (time < time[-1] - SETTLING_S)
    found: list[dict[str, object]] = []
    for flexibility in structures:
        structure = make_structure(flexibility=flexibility)
        modes = np.linalg.eigvals(state_matrix(structure))
        sway_hz, pitch_hz = np.sort(np.abs(modes[modes.imag > 0]))[:2] / (2 * np.pi)
        faults = Faults()
        machine = faults.machine.model_copy(update={"flexibility": flexibility})
        treadmill = make_treadmill(faults.model_copy(update={"machine": machine}), TREADMILL_SEED)
        trial = record_signal_trial(signal, seed=TRIAL_SEED, treadmill=treadmill, load=load)
        raw = trial.plates[0].wrench[:, : len(FORCES)]
        for force in (raw, low_pass(raw, ANALOG_HZ, CUTOFF_HZ, "zero_phase")):
            rms = dict(zip(FORCES, force[inside].std(axis=0), strict=True))
            hz = {"sway_hz": sway_hz, "pitch_hz": pitch_hz}
            found.append({"flexibility": flexibility, **hz, "filtered": force is not raw, **rms})
    return pd.DataFrame(found)
