# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # What does each fault look like?
#
# A residual is large. Why? We take a realistic trial, introduce one more fault at a time, and look
# at its effect on the six curves, on the limits, and on the notes. The platform pitches in this
# trial, ten degrees up and down within half a minute, and the plates are compensated.

# %%
from dataclasses import replace

import matplotlib.pyplot as plt

import hbm_residuals as hr

lab = hr.virtual_lab

# %% [markdown]
# ## The reference trial
#
# The reference is realistic, not perfect: the body is not the one that the model assumes, soft
# tissue and skin move, the treadmill bends and is shaken, and load cells and cameras are noisy, as
# in a good laboratory. Its peaks exceed the limits of Hicks et al. (2015), too.

# %%
short = lab.Protocol(subjects=1, conditions=("pitch",), pitch_s=32.0, beside_s=0.0)
folder = lab.simulate_study("pitching", lab.Setting(seed=1, protocol=short))
treadmill = hr.read_study(folder).file.treadmill
calibration = hr.read_calibration(folder / "calibration.c3d", treadmill)
subject = hr.Subject(id="sub01", sex="male", mass_kg=83.0, height_m=1.85)
walking = hr.Condition(skip_s=8.0)  # at constant belt speed
recording = hr.read(folder / "sub01_pitch.c3d")


def process(recording=recording, subject=subject, treadmill=treadmill):
    """Process the trial with one thing changed."""
    laboratory = hr.Laboratory(treadmill, calibration)
    return hr.process(recording, subject, hr.Settings(), laboratory=laboratory, condition=walking)


trials = {"reference": process()}

# %% [markdown]
# ## Six faults
#
# **Swapped markers.** For three seconds, the labels of the left anterior and posterior pelvis
# markers are exchanged; and, in a separate trial, those of the right knee and ankle.


# %%
def swapped(*names):
    """Exchange the labels of two markers for three seconds."""
    markers, position = recording.markers, recording.markers.position.copy()
    first, second = (markers.names.index(name) for name in names)
    position[2200:2500, [first, second]] = position[2200:2500, [second, first]]
    return replace(recording, markers=replace(markers, position=position))


trials["swapped pelvis"] = process(swapped("LASIS", "LPSIS"))
trials["swapped leg"] = process(swapped("RLEK", "RLM"))

# %% [markdown]
# **A delay of 30 ms.** The plates are delayed: two devices were started manually, or one of them
# filters.

# %%
delayed = tuple(replace(plate, time=plate.time + 0.03) for plate in recording.plates)
trials["plates delayed 30 ms"] = process(replace(recording, plates=delayed))

# %% [markdown]
# **A wrong mass.** 73 kg was entered instead of 83 kg.

# %%
trials["10 kg too light"] = process(subject=subject.model_copy(update={"mass_kg": 73.0}))

# %% [markdown]
# **No platform pose.** The plates tilt, but the software does not know: their forces stay in the
# axes of the neutral position.

# %%
fixed = treadmill.model_copy(update={"platform": None})
trials["no platform pose"] = process(treadmill=fixed)

# %% [markdown]
# **A dead accelerometer.** One channel, the forward axis of the rear left sensor, is constant.

# %%
values, channel = recording.analog.values.copy(), recording.analog.names.index("rear_left.X")
values[:, channel] = values[0, channel]
dead = replace(recording, analog=replace(recording.analog, values=values))
trials["dead accelerometer"] = process(dead)

# %% [markdown]
# ## The numbers
#
# RMS of each residual, peaks as multiples of the limits of Hicks, the delay that is found, and the
# warnings that the reference does not have.

# %%
for name, result in trials.items():
    table = hr.residuals(result, name).query("compensated and headline")
    peaks = hr.thresholds(result).query("compensated")
    times = ", ".join(f"{value:.1f}×" for value in peaks["peak"] / peaks["limit"])
    rms = " ".join(
        f"{axis} {rms:.1f}" for axis, rms in zip(table["axis"], table["rms"], strict=True)
    )
    print(f"{name}: {rms}; limits {times}; delay {1000 * result.delay_s:.1f} ms")
    for note in result.notes:
        if note.level == "warning" and note not in trials["reference"].notes:
            print(f"    {note}")


def show(*names):
    """Draw all right gait cycles of faulty trials, and in grey those of the reference."""
    figure, panels = plt.subplots(
        len(names),
        6,
        figsize=(15, 2 * len(names) + 0.5),
        sharex=True,
        sharey="col",
        layout="constrained",
    )
    reference = hr.cycles(trials["reference"], "compensated")["right"]
    for row, name in zip(panels, names, strict=True):
        curves = hr.cycles(trials[name], "compensated")["right"]
        for k, panel in enumerate(row):
            panel.plot(curves[..., k].T, color="#D55E00", lw=0.6)
            panel.plot(reference[..., k].T, color="0.55", lw=0.4)
            panel.axhline(0, color="black", lw=0.5)
        row[0].set_ylabel(name)
    for k, axis in enumerate(("Fx, N", "Fy, N", "Fz, N", "Mx, N·m", "My, N·m", "Mz, N·m")):
        panels[0, k].set_title(axis)
        panels[-1, k].set(xlabel="gait cycle (%)", xlim=(0, 100))
    return figure


# %% [markdown]
# ## Faults of markers
#
# **Swapped pelvis markers.** A few outlying cycles; all others coincide with the reference. A
# warning names the two labels and when they were exchanged. Correct the labels: impossible
# positions are left out, now of the one marker, now of the other, and the model's pelvis jumps in
# between, which requires forces that did not act.
#
# **Swapped knee and ankle.** Not visible in the residuals! Both positions are left out throughout,
# and the other markers of the leg show the same motion. Residuals do not reveal every fault: look
# at the warnings, too.

# %%
show("swapped pelvis", "swapped leg")

# %% [markdown]
# ## Faults of plates and body mass
#
# **Plates delayed 30 ms.** The same shape in every cycle, largest in Fx and Fz where the forces
# change fastest, after foot strike and around push-off, and crossing zero: the difference of a
# curve and its delayed copy. The software estimates the delay. State it as `plate_delay_s`.
#
# **10 kg too light.** Fz keeps its shape and decreases by 98 N, the weight of ten kilograms; the
# other forces hardly change. A negative Fz means that the plates measure more than the model
# weighs.

# %%
show("plates delayed 30 ms", "10 kg too light")

# %% [markdown]
# ## Faults of the treadmill
#
# **No platform pose.** A fan: the cycles shift up and down as the platform tilts. Fx reaches a
# quarter of body weight, and My follows; both are larger while the ground reaction is large.
#
# **Dead accelerometer.** A similar fan in the same residuals, because part of the plates' own
# weight is not compensated. The warnings name the dead channel. So does the shape: without a pose,
# the fan grows with the ground reaction; with a dead sensor, it hardly depends on the gait cycle.

# %%
figure = show("no platform pose", "dead accelerometer")
figure.savefig("05_reading_residuals.png", dpi=100)
