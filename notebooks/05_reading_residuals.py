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
# at its effect on the six curves, on the thresholds, and on what the viewer shows. The platform
# pitches in this trial, ten degrees up and down within half a minute, and the plates are
# compensated.

# %%
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from hbm.markers import Markers
from pipeline.config.schema import Condition, Platform, Settings, Subject, Treadmill
from pipeline.figures.residuals import axis_label
from pipeline.figures.style import COLOURS
from pipeline.trial.ground.calibration_recording import fit_calibration
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.process import process_recording
from pipeline.trial.residuals import (
    AXES,
    UNITS,
    cycle_residuals,
    marker_table,
    residual_table,
    threshold_table,
)
from pipeline.viewer.trial import write_recording
from pipeline.virtual_lab.machine.instrumented_treadmill import PLATFORM_MARKERS_M, make_treadmill
from pipeline.virtual_lab.protocol.walking_protocol import Protocol, Setting
from pipeline.virtual_lab.protocol.walking_trial import run_calibration, run_trial, study_subject

# %% [markdown]
# ## The reference trial
#
# The reference is realistic, not perfect: the body is not the one that the model assumes, soft
# tissue and skin move, the treadmill bends and is shaken, and load cells and cameras are noisy, as
# in a good laboratory. Its peaks exceed the thresholds of Hicks et al. (2015) too, 1.5 and 3.3
# times. The grey curves in the picture show it.

# %%
setting = Setting(seed=1, protocol=Protocol(subjects=1, pitch_s=32.0))
virtual_treadmill = make_treadmill(setting.faults, setting.seed)
recording = run_trial(setting, virtual_treadmill, study_subject(setting, 0), 0, "pitch").recording
empty = run_calibration(setting, virtual_treadmill)

treadmill = Treadmill(
    accelerometers={
        sensor.name: tuple(f"{sensor.name}.{axis}" for axis in "XYZ")
        for sensor in virtual_treadmill.sensors
    },
    platform=Platform(markers=tuple(PLATFORM_MARKERS_M)),
)
calibration = fit_calibration(empty, treadmill)
subject = Subject(id="sub01", sex="male", mass_kg=83.0, height_m=1.85)
walking = Condition(skip_s=setting.protocol.steady_s)


def process(recording=recording, subject=subject, settings=None, treadmill=treadmill):
    """Process the trial with the same settings unless stated otherwise."""
    return process_recording(
        recording,
        subject,
        settings or Settings(),
        laboratory=Laboratory(treadmill, calibration),
        condition=walking,
    )


trials = {"reference": process()}

# %% [markdown]
# ## Six faults
#
# **Swapped markers.** For three seconds, the labels of the left anterior and posterior pelvis
# markers are exchanged; and, in a separate trial, those of the right knee and ankle.

# %%
markers = recording.markers
swapped_frames = (markers.time > 22.0) & (markers.time < 25.0)


def swap(first, second):
    """Exchange the labels of two markers for three seconds."""
    pair = [markers.names.index(name) for name in (first, second)]
    position = markers.position.copy()
    position[np.ix_(swapped_frames, pair)] = position[np.ix_(swapped_frames, pair[::-1])]
    return replace(recording, markers=Markers(markers.time, markers.names, position))


swapped = swap("LASIS", "LPSIS")
trials["swapped pelvis"] = process(swapped)
trials["swapped leg"] = process(swap("RLEK", "RLM"))

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
trials["no platform pose"] = process(treadmill=treadmill.model_copy(update={"platform": None}))

# %% [markdown]
# **A dead accelerometer.** One channel, the forward axis of the rear left sensor, is constant.

# %%
analog = recording.analog
values = analog.values.copy()
channel = analog.names.index("rear_left.X")
values[:, channel] = values[0, channel]
trials["dead accelerometer"] = process(replace(recording, analog=replace(analog, values=values)))

# %% [markdown]
# ## The numbers

# %%
print(f"{'RMS':20s}", *(f"{axis:>7}" for axis in AXES), "  Hicks F, M   markers  delay")
for name, result in trials.items():
    table = residual_table(result, name)
    rms = table.loc[table["compensated"] & table["headline"], "rms"]
    limits = threshold_table(result)
    peaks = limits[limits["compensated"]]
    share = " ".join(f"{v:4.1f}×" for v in peaks["peak"] / peaks["limit"])
    error = marker_table(result)["rms_mm"].iloc[-1]
    print(
        f"{name:20s}",
        *(f"{value:7.1f}" for value in rms),
        f"  {share}  {error:4.1f} mm  {1000 * result.delay_s:5.1f} ms",
    )

# %% [markdown]
# And the notes that these trials have but the reference does not:

# %%
reference_notes = set(trials["reference"].notes)
for name, result in trials.items():
    for note in result.notes:
        if note not in reference_notes:
            print(f"{name}: {note}")
print(marker_table(trials["swapped leg"]).nlargest(4, "missing_percent"))

# %% [markdown]
# ## What the viewer shows
#
# `hbm view results` opens the trials of a study. Here we write a single trial; open it with `rerun
# swapped_pelvis.rrd`.

# %%
write_recording(trials["swapped pelvis"], Path("swapped_pelvis.rrd"))

# %% [markdown]
# ## The picture
#
# One row per fault, one column per residual; every thin line is one gait cycle, grey in the
# reference. Each fault has a signature.
#
# **Swapped pelvis markers.** A few outlying cycles; all others coincide with the reference. A note
# names the two labels and when they were exchanged. Positions that cannot be are left out, now of
# the one marker, now of the other, and the model's pelvis jumps in between, which requires forces
# that did not act: the *peaks* exceed the thresholds 38 and 14 times, and Fx and Fy have four to
# five times their RMS. Correct the labels; leaving out is no repair.
#
# **Swapped knee and ankle.** Not visible in the residuals! Both positions are left out throughout,
# and the other markers of the leg show the same motion. Residuals do not reveal every fault: here
# the notes do, and the two markers that are missing for a part of the trial. Look at both.
#
# **Plates delayed 30 ms.** The same shape in every cycle, largest in Fx and Fz where the forces
# change fastest, after foot strike and around push-off, and crossing zero: the difference of a
# curve and its delayed copy. The software estimates the delay: 32 ms, of which the reference has 2.
# State it as `plate_delay_s`. In the viewer: residual arrows that change direction with every step.
#
# **10 kg too light.** Fz keeps its shape and decreases by 98 N, the weight of ten kilograms; the
# other forces hardly change. A negative Fz means that the plates measure more than the model
# weighs. In the viewer: an arrow at the pelvis that always points down, also while the subject
# stands still.
#
# **No platform pose.** A fan: the cycles shift up and down as the platform tilts. Fx reaches a
# quarter of body weight, and My follows; both are larger while the ground reaction is large. In the
# viewer: the plates stay level while the markers on the platform move up and down.
#
# **Dead accelerometer.** A similar fan in the same residuals, because part of the plates' own
# weight is not compensated. The notes distinguish the two: they name the dead channel. So does the
# shape: without a pose, the fan grows with the ground reaction; with a dead sensor, it hardly
# depends on the gait cycle. In the viewer, the compensated curve is a scaled copy of the measured
# one.

# %%
shown = list(trials)[1:]
figure, panels = plt.subplots(
    len(shown), 6, figsize=(15, 2 * len(shown)), sharex=True, sharey="col", layout="constrained"
)
reference_curves = cycle_residuals(trials["reference"], "compensated")["right"]
for row, name in zip(panels, shown, strict=True):
    curves = cycle_residuals(trials[name], "compensated")["right"]
    for k, panel in enumerate(row):
        panel.plot(curves[..., k].T, color=COLOURS["measured"], lw=0.6)
        panel.plot(reference_curves[..., k].T, color="0.55", lw=0.4)
        panel.axhline(0, color="black", lw=0.5)
    row[0].set_ylabel(name)
for k in range(6):
    panels[0, k].set_title(f"{axis_label(k)}, {UNITS[k]}")
    panels[-1, k].set(xlabel="gait cycle (%)", xlim=(0, 100))
figure.suptitle("Every right gait cycle with each fault (vermilion) and in the reference (grey)")
figure.savefig("05_reading_residuals.png", dpi=100)
