# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # What the platform does to your plates
#
# A force plate is a lid on load cells. On a treadmill the lid is a belt assembly of a hundred
# kilograms and more. Move the whole machine, and the cells feel the assembly's inertia; tilt it,
# and they feel its weight from another side. Nobody stands on it, and yet the plates measure.

# %%
import matplotlib.pyplot as plt
import numpy as np

from compensation import fit_inertia, pitch_and_sway_signals, validation_signals
from pipeline.config.schema import Treadmill
from pipeline.figures.style import COLOURS
from pipeline.trial.ground.laboratory import accelerations, setup_of
from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.protocol.instrumented_treadmill import make_treadmill
from pipeline.virtual_lab.protocol.walking_trial import run_signal

# %% [markdown]
# ## The laboratory
#
# A treadmill with two plates and two accelerometers on its frame, all with the errors that
# instruments usually have: noise, cross-talk, offsets, crooked axes, 3 ms of delay.

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
for side, assembly in zip(("left", "right"), virtual_treadmill.machine.assemblies, strict=True):
    x, y, z = assembly.center
    print(f"{side} belt: {assembly.mass:.0f} kg, centre {x:.2f} m forward, {z:.2f} m up")


def record_empty(signal, seed):
    """Run a signal with nobody on the belts: times, what is felt, what plate 1 measures."""
    recording = run_signal(virtual_treadmill, signal, np.random.default_rng(seed))
    setup = setup_of(recording, treadmill)
    time, felt = accelerations(recording, treadmill)
    felt, wrench = (
        setup.low_pass(values, setup.rate_hz)
        for values in (felt, recording.plates[0].wrench_in_plate)
    )
    return time, felt, wrench, setup


# %% [markdown]
# ## What an empty plate measures
#
# First sway: 5 cm to one side within half a second, slowly back seven seconds later. Then
# pitch: ten degrees up and down in half a minute.

# %%
signals = {signal.name: signal for signal in validation_signals()}
trials = {name: record_empty(signals[name], seed) for seed, name in enumerate(("sway", "pitch"))}
components = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
for name, (_, _, wrench, _) in trials.items():
    largest = np.abs(wrench).max(axis=0)
    print(name, "at most:", *(f"{c} {v:.0f}" for c, v in zip(components, largest, strict=True)))

# %% [markdown]
# ## Learning it
#
# Inertia and weight are both linear in what the accelerometers read. So one minute of random
# motion of the empty treadmill, with some jerks of sway in it, is enough for a linear fit: six
# components, each a weighted sum of six readings and a constant.

# %%
drawn = {signal.name: signal for signal in pitch_and_sway_signals(seed=1, belt_speed=3.0)}
calibration = drawn["square_sway_60s_3mps"]
_, felt, wrench, setup = record_empty(calibration, seed=2)
model = fit_inertia(felt, wrench, setup)
print("R² of the fit:", *(f"{c} {v:.4f}" for c, v in zip(components, model.r_squared, strict=True)))

# %% [markdown]
# ## Taking it away again
#
# In trials that the fit has not seen.

# %%
left = {name: model.compensate(felt, wrench) for name, (_, felt, wrench, _) in trials.items()}
for name, (_, _, wrench, _) in trials.items():
    before, after = (np.sqrt(np.mean(w**2, axis=0)) for w in (wrench, left[name]))
    print(name)
    for k, component in enumerate(components):
        print(f"  {component}: RMS {before[k]:6.2f} -> {after[k]:5.2f} {'N' if k < 3 else 'N·m'}")

# %% [markdown]
# ## The picture
#
# Above, one move to the side, drawn large. It takes under half a second; at its start and its end
# the empty plate measures 400 N sideways: a push as large as half a person's weight that nobody
# gave. The centre of mass sits low and in front, so the push also twists (Mx, Mz). Below, pitch:
# slow, hardly any inertia in it. What changes is the direction of weight: Fx follows the angle, and
# Fz, which only cares how far the plate is tilted, drops twice per period.
#
# What is left in blue is about as large as the noise of the plate, with a slow drift that no
# accelerometer can know of and, in Fz, about a newton that still follows the pitch.

# %%
figure, panels = plt.subplots(2, 3, figsize=(11, 6), layout="constrained", sharex="row")
shown = {"sway": (1, 3, 5), "pitch": (0, 2, 4)}
for row, (name, chosen) in zip(panels, shown.items(), strict=True):
    time, _, wrench, _ = trials[name]
    for panel, k in zip(row, chosen, strict=True):
        panel.plot(time, wrench[:, k], color=COLOURS["measured"], label="measured", lw=1)
        panel.plot(time, left[name][:, k], color=COLOURS["compensated"], label="compensated", lw=1)
        panel.set(title=f"{name}: {components[k]}", ylabel="N" if k < 3 else "N·m")
        panel.set_xlabel("time (s)")
for panel in panels[0]:
    panel.set_xlim(3.8, 4.8)
panels[0, 0].legend(frameon=False)
figure.suptitle("An empty plate on a moving treadmill, before and after compensation")
figure.savefig("02_what_the_platform_does_to_your_plates.png", dpi=100)
