"""What the rigid method leaves on the rigid and on the flexible machine.

``python -m tests.virtual_machine.left_over [signal] [seed]`` prints, for two and four
accelerometers, R² of the calibration (filtered at 20 Hz, as the thesis), and root mean squares of
the empty left plate as measured and as left over [N, N·m] at 20 and at 6 Hz, in the calibration
itself and in the thesis' validation trials, in which somebody is beside the plate.
"""

import sys
from collections.abc import Iterator

import numpy as np

from compensation import fit_inertia
from compensation.protocol import (
    ADVISED_PLATFORM_SIGNAL,
    pitch_and_sway_signals,
    validation_signals,
)
from hbm.signals.filtering import low_pass
from hbm.spatial import GRAVITY_MPS2, Array
from pipeline.io.recording import Recording
from pipeline.virtual_lab.faults import AccelerometerFaults, Faults, MachineFaults
from pipeline.virtual_lab.machine.instrumented_treadmill import (
    InstrumentedTreadmill,
    make_treadmill,
)
from pipeline.virtual_lab.machine.instruments import ANALOG_HZ, SAMPLES_PER_FRAME
from pipeline.virtual_lab.protocol.calibration_trial import record_signal_trial, sample_times
from pipeline.virtual_lab.protocol.ranking_study import BESIDE_THE_BELTS, BYSTANDERS

FIT_HZ = 20.0
CUTOFFS_HZ = (20.0, 6.0)
EDGE = 100


def main(name: str = ADVISED_PLATFORM_SIGNAL, seed: int = 1) -> None:
    """Print the table."""
    for machine, flexibility in (("rigid", 0.0), ("flexible", 1.0)):
        for sensors in (2, 4):
            faults = Faults(
                machine=MachineFaults(flexibility=flexibility),
                accelerometers=AccelerometerFaults(sensors=sensors),
            )
            treadmill = make_treadmill(faults, seed)
            trials = dict(recordings(treadmill, name, seed))
            calibration = trials[name]
            model = fit_inertia(*(filtered(x, FIT_HZ) for x in calibration))
            print(f"\n{machine}, {sensors} accelerometers: R² {np.round(model.r_squared, 4)}")
            for trial, (felt, wrench) in trials.items():
                for cutoff_hz in CUTOFFS_HZ:
                    a, w = filtered(felt, cutoff_hz), filtered(wrench, cutoff_hz)
                    left = w - model.predict(a)
                    print(
                        f"  {trial:24}{cutoff_hz:3.0f} Hz  raw {np.round(w.std(axis=0), 1)}"
                        f"  left {np.round(left.std(axis=0), 2)}"
                    )


def recordings(
    treadmill: InstrumentedTreadmill, name: str, seed: int
) -> Iterator[tuple[str, tuple[Array, Array]]]:
    """Give the calibration and the validation trials: accelerations and the left plate's wrench."""
    belt_mps = float(name.removesuffix("mps").rpartition("_")[2])
    signals = {signal.name: signal for signal in pitch_and_sway_signals(seed, belt_mps)}
    yield name, arrays(record_signal_trial(signals[name], seed=seed, treadmill=treadmill))
    for k, signal in enumerate(validation_signals(seed)[:4], start=1):
        person = BYSTANDERS[signal.name]
        load = person(sample_times(signal, ANALOG_HZ), np.random.default_rng((seed, k)))
        where = "on_frame" if person in BESIDE_THE_BELTS else "load"
        recording = record_signal_trial(
            signal, seed=100 * seed + k, treadmill=treadmill, **{where: load}
        )
        yield signal.name, arrays(recording)


def arrays(recording: Recording) -> tuple[Array, Array]:
    """Give accelerations [m/s²] and the left plate's wrench."""
    names = [name for name in recording.analog.names if name[-2:] in (".X", ".Y", ".Z")]
    felt = np.column_stack([recording.analog.channel(name) for name in names])
    return GRAVITY_MPS2 * felt, recording.plates[0].wrench_in_plate


def filtered(values: Array, cutoff_hz: float) -> Array:
    """Low-pass with zero phase, at the frames' rate, without the ends."""
    smooth = low_pass(values, ANALOG_HZ, cutoff_hz, "zero_phase")
    return smooth[::SAMPLES_PER_FRAME][EDGE:-EDGE]


if __name__ == "__main__":
    np.set_printoptions(suppress=True, linewidth=140)
    main(*sys.argv[1:2], *map(int, sys.argv[2:3]))
