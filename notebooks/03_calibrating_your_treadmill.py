# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # How many accelerometers does a calibration need?
#
# Notebook 02 showed what a moving platform adds to its plates, and how two accelerometers remove
# it. Here the same machine has four, and some of them are ignored. On your own machine, the steps
# are `hbm calibration signals`, a recording, and `hbm calibration fit`.

# %%
import matplotlib.pyplot as plt

import hbm_residuals as hr

lab = hr.virtual_lab

# %% [markdown]
# ## The recordings
#
# The treadmill is empty, and its belts run. One recording is for the fit. Three are not: quick
# sway, slow pitch, and the platform at rest, which shows the floor, the limit of any compensation.

# %%
instruments = lab.Faults(accelerometers=lab.AccelerometerFaults(sensors=4))
drawn = {signal.name: signal for signal in lab.pitch_and_sway_signals(seed=1, belt_speed=3.0)}
signals = {signal.name: signal for signal in lab.validation_signals()}
sway = signals["sway"]
rest = lab.Signal("rest", sway.rate_hz, 0 * sway.sway, 0 * sway.pitch, sway.belt_speed)
fitted = lab.record_signal_trial(drawn[lab.Protocol().calibration], seed=0, faults=instruments)
trials = {
    signal.name: lab.record_signal_trial(signal, seed=1, faults=instruments)
    for signal in (sway, signals["pitch"], rest)
}

# %% [markdown]
# ## One, two, three or four accelerometers
#
# The standard deviation of the empty plate in each trial, as measured and as compensated.

# %%
components = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
sensors = [name.removesuffix(".X") for name in fitted.analog.names if name.endswith(".X")]
remaining, measured = {}, {}
for count in (1, 2, 3, 4):
    treadmill = hr.Treadmill(
        accelerometers={name: tuple(f"{name}.{a}" for a in "XYZ") for name in sensors[:count]},
        cutoff_hz=20.0,
    )
    calibration = hr.fit_calibration(fitted, treadmill)
    model = calibration.plates["plate 1"]
    for name, trial in trials.items():
        samples = hr.plate_samples(trial, treadmill, calibration.sensors, None)
        acceleration, wrench = samples["plate 1"]
        measured[name] = wrench.std(axis=0)
        remaining[name, count] = model.compensate(acceleration, wrench).std(axis=0)
    print(
        f"{count} accelerometers: R² of Fz {model.r_squared[2]:.4f}, of My {model.r_squared[4]:.4f}"
    )

for name, before in measured.items():
    print(f"{name:5}                ", *(f"{c:>6}" for c in components))
    print("  measured           ", *(f"{v:6.2f}" for v in before))
    for count in (1, 2, 3, 4):
        print(f"  {count} accelerometer(s) ", *(f"{v:6.2f}" for v in remaining[name, count]))


def show(name):
    """Draw what remains of each component, on a logarithmic scale, with the floor."""
    figure, panel = plt.subplots(figsize=(9, 3.5), layout="constrained")
    series = {"measured": measured[name]}
    series |= {f"{k} accelerometer{'s' * (k > 1)}": remaining[name, k] for k in (1, 2, 3, 4)}
    blues = [(0.0, 0.45, 0.7, alpha) for alpha in (0.4, 0.6, 0.8, 1.0)]
    for k, ((label, values), colour) in enumerate(
        zip(series.items(), ["#D55E00", *blues], strict=True)
    ):
        places = [axis - 0.36 + 0.18 * k for axis in range(6)]
        panel.bar(places, values, 0.18, color=colour, label=label)
    for axis, floor in enumerate(measured["rest"]):
        panel.hlines(floor, axis - 0.5, axis + 0.5, color="black", ls="--")
    panel.set_yscale("log")
    panel.set_xticks(range(6), components)
    panel.set(title=f"{name}: empty plate", ylabel="standard deviation (N, N·m)")
    panel.legend(frameon=False, fontsize=8, ncols=5, loc="upper center")
    return figure


# %% [markdown]
# ## Sway
#
# One accelerometer is enough for sway. The dashed line is the floor: what belts and rollers do to
# the plate while the platform is at rest.

# %%
show("sway")

# %% [markdown]
# ## Pitch
#
# One is not enough for pitch. A single sensor measures the platform's angle and its angular
# acceleration in the same channels and cannot distinguish them, so the fit is a compromise that
# suits its own recording. A second sensor at the other end of the platform resolves this. The
# third and the fourth add little here. People who walk shake the platform also about the line
# between two sensors; there, more of them help (the page *Calibration*).

# %%
figure = show("pitch")
figure.savefig("03_calibrating_your_treadmill.png", dpi=100)
