# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # What does a moving platform add to its plates?
#
# A force plate is a rigid body on load cells. On a treadmill this body is a belt assembly of more
# than a hundred kilograms. When the machine accelerates, the load cells measure the assembly's
# inertia; when it tilts, they measure its weight in another direction, even with nobody on the
# belts.

# %%
import matplotlib.pyplot as plt
import numpy as np

from compensation import fit_inertia, pitch_and_sway_signals, validation_signals
from compensation.protocol import ADVISED_PLATFORM_SIGNAL
from pipeline.config.schema import Treadmill
from pipeline.figures.style import COLOURS
from pipeline.trial.ground.accelerometers import accelerations
from pipeline.trial.ground.calibration_recording import setup_of
from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.instrumented_treadmill import make_treadmill
from pipeline.virtual_lab.machine.platform import BELT_ASSEMBLIES
from pipeline.virtual_lab.protocol.walking_trial import run_signal

# %% [markdown]
# ## The laboratory
#
# A treadmill with two plates and two accelerometers on its frame. The frame stands on an elastic
# base and bends a little, belts and rollers shake it, and all instruments have typical errors:
# noise, cross-talk, offsets, misaligned axes, clocks and delays of their own.

# %%
virtual_treadmill = make_treadmill(Faults(), seed=1)
cutoff_hz = 20.0
treadmill = Treadmill(
    accelerometers={
        sensor.name: tuple(f"{sensor.name}.{axis}" for axis in "XYZ")
        for sensor in virtual_treadmill.sensors
    },
    cutoff_hz=cutoff_hz,
)
for side, assembly in zip(("left", "right"), BELT_ASSEMBLIES, strict=True):
    x, y, z = assembly.center
    print(f"{side} belt: {assembly.mass:.0f} kg, centre {x:.2f} m forward, {z:.2f} m up")


def record_empty(signal, seed):
    """Run a signal with empty belts: times, specific force, wrench of plate 1, set-up."""
    recording = run_signal(virtual_treadmill, signal, np.random.default_rng(seed))
    setup = setup_of(recording, treadmill)
    time, acceleration = accelerations(recording, treadmill)
    acceleration, wrench = (
        setup.low_pass(values, setup.rate_hz)
        for values in (acceleration, recording.plates[0].wrench_in_plate)
    )
    return time, acceleration, wrench, setup


# %% [markdown]
# ## What an empty plate measures
#
# First sway: 5 cm to one side within half a second, and slowly back seven seconds later. Then
# pitch: ten degrees up and down within half a minute.

# %%
signals = {signal.name: signal for signal in validation_signals()}
trials = {name: record_empty(signals[name], seed) for seed, name in enumerate(("sway", "pitch"))}
components = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
for name, (_, _, wrench, _) in trials.items():
    peaks = np.abs(wrench).max(axis=0)
    print(name, "peaks:", *(f"{c} {v:.0f}" for c, v in zip(components, peaks, strict=True)))

# %% [markdown]
# ## Fitting the model
#
# Inertial forces and weight are both linear in the accelerometer signals. One minute of random
# motion of the empty treadmill, with rapid moves and held positions, is therefore enough for a
# linear fit: each of the six components is a weighted sum of six signals and a constant.

# %%
drawn = {signal.name: signal for signal in pitch_and_sway_signals(seed=1, belt_speed=3.0)}
calibration = drawn[ADVISED_PLATFORM_SIGNAL]
_, acceleration, wrench, setup = record_empty(calibration, seed=2)
model = fit_inertia(acceleration, wrench, setup)
print("R² of the fit:", *(f"{c} {v:.4f}" for c, v in zip(components, model.r_squared, strict=True)))

# %% [markdown]
# ## Compensation
#
# In trials that were not used for the fit.

# %%
remaining = {
    name: model.compensate(acceleration, wrench)
    for name, (_, acceleration, wrench, _) in trials.items()
}
for name, (_, _, wrench, _) in trials.items():
    before, after = (np.sqrt(np.mean(w**2, axis=0)) for w in (wrench, remaining[name]))
    print(name)
    for k, component in enumerate(components):
        print(f"  {component}: RMS {before[k]:6.2f} -> {after[k]:5.2f} {'N' if k < 3 else 'N·m'}")

# %% [markdown]
# ## The picture
#
# Top: one sway, magnified. It takes less than half a second; at its start and end the empty plate
# measures a lateral force of more than 600 N, nearly the body weight of a person. The centre of
# mass of the belt assembly is low and in front, so there are moments too (Mx, Mz). Bottom: pitch,
# too slow for noticeable inertia. The direction of the weight changes: Fx follows the angle, and
# Fz, which depends only on the magnitude of the tilt, decreases twice per period.
#
# After compensation (blue), three things remain. While the platform sways, waves of 15 N: the
# accelerometers are about two milliseconds later than the plate, and this fit by hand does not
# correct it; `hbm calibration fit` does (notebook 03). All the time, 1 to 2 N and 2.4 N·m of
# pitch moment: rollers and belts shake the plate, and accelerometers on the frame hardly show it.
# And a zero of up to 2 N that is another one in every recording.

# %%
figure, panels = plt.subplots(2, 3, figsize=(11, 6), layout="constrained", sharex="row")
shown = {"sway": (1, 3, 5), "pitch": (0, 2, 4)}
for row, (name, chosen) in zip(panels, shown.items(), strict=True):
    time, _, wrench, _ = trials[name]
    for panel, k in zip(row, chosen, strict=True):
        panel.plot(time, wrench[:, k], color=COLOURS["measured"], label="measured", lw=1)
        panel.plot(
            time, remaining[name][:, k], color=COLOURS["compensated"], label="compensated", lw=1
        )
        panel.set(title=f"{name}: {components[k]}", ylabel="N" if k < 3 else "N·m")
        panel.set_xlabel("time (s)")
for panel in panels[0]:
    panel.set_xlim(3.8, 4.8)
panels[0, 0].legend(frameon=False)
figure.suptitle("Empty plate on a moving treadmill, as measured and compensated")
figure.savefig("02_what_the_platform_does_to_your_plates.png", dpi=100)
