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

import hbm_residuals as hr

lab = hr.virtual_lab

# %% [markdown]
# ## What an empty plate measures
#
# A treadmill with two accelerometers on its frame. The frame stands on an elastic base, belts and
# rollers shake it, and all instruments have typical errors. First sway: 5 cm to one side within
# half a second, and slowly back seven seconds later. Then pitch: ten degrees up and down within
# half a minute.

# %%
components = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
signals = {signal.name: signal for signal in lab.validation_signals()}
trials = {name: lab.record_signal_trial(signals[name], seed=1) for name in ("sway", "pitch")}
for name, trial in trials.items():
    peaks = abs(trial.plates[0].wrench_in_plate).max(axis=0)
    print(name, "peaks:", *(f"{c} {v:.0f}" for c, v in zip(components, peaks, strict=True)))

# %% [markdown]
# ## The model
#
# Inertial forces and weight are both linear in the accelerometer signals. A few minutes of random
# motion of the empty treadmill are therefore enough for a linear fit: each of the six components is
# a weighted sum of six signals and a constant.

# %%
drawn = {signal.name: signal for signal in lab.pitch_and_sway_signals(seed=1, belt_speed=3.0)}
recording = lab.record_signal_trial(drawn[lab.Protocol().calibration], seed=2)
treadmill = hr.Treadmill(
    accelerometers={
        sensor: tuple(f"{sensor}.{axis}" for axis in "XYZ")
        for sensor in ("rear_left", "front_right")
    },
    cutoff_hz=20.0,
)
calibration = hr.fit_calibration(recording, treadmill)
model = calibration.plates["plate 1"]
print("R² of the fit:", *(f"{c} {v:.4f}" for c, v in zip(components, model.r_squared, strict=True)))

# %% [markdown]
# ## Compensation
#
# In trials that were not used for the fit.

# %%
wrenches = {}
for name, trial in trials.items():
    samples = hr.plate_samples(trial, treadmill, calibration.sensors, None)
    acceleration, measured = samples["plate 1"]
    wrenches[name] = measured, model.compensate(acceleration, measured)
    print(name)
    for k, component in enumerate(components):
        before, after = ((wrench[:, k] ** 2).mean() ** 0.5 for wrench in wrenches[name])
        print(f"  {component}: RMS {before:6.2f} -> {after:5.2f} {'N' if k < 3 else 'N·m'}")


def show(name, shown, start_s, stop_s):
    """Draw components of the plate as measured and as compensated."""
    figure, panels = plt.subplots(1, len(shown), figsize=(11, 3.2), layout="constrained")
    time = trials[name].plates[0].time[: len(wrenches[name][0])]
    rows = (time > start_s) & (time < stop_s)
    for panel, k in zip(panels, shown, strict=True):
        for wrench, colour, label in zip(
            wrenches[name], ("#D55E00", "#0072B2"), ("measured", "compensated"), strict=True
        ):
            panel.plot(time[rows], wrench[rows, k], color=colour, label=label, lw=1)
        unit = "N" if k < 3 else "N·m"
        panel.set(title=f"{name}: {components[k]}", ylabel=unit, xlabel="time (s)")
    panels[0].legend(frameon=False, fontsize=8, loc="upper left")
    return figure


# %% [markdown]
# ## One sway
#
# It takes less than half a second. At its start and end the empty plate measures a lateral force
# near the body weight of a person. The centre of mass of the belt assembly is low and in front, so
# there are moments too.

# %%
show("sway", (1, 3, 5), 2.8, 3.8)

# %% [markdown]
# ## Pitch
#
# It is too slow for noticeable inertia. The direction of the weight changes: Fx follows the angle,
# and Fz decreases with it. After compensation (blue), rollers and belts remain, which shake the
# plate more than the frame that carries the accelerometers, and a zero that is another one in every
# recording.

# %%
figure = show("pitch", (0, 2, 4), 0.0, 70.0)
figure.savefig("02_what_the_platform_does_to_your_plates.png", dpi=100)
