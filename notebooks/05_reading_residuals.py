# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Reading residuals: which fault looks how
#
# A residual is large. Why? We take one trial in which everything is in order, spoil one thing at a
# time, and look at what each does to the six curves, to the thresholds, and to what the viewer
# shows. The platform pitches in this trial, ten degrees up and down in half a minute, and the
# plates are compensated.

# %%
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from hbm.markers import Markers
from pipeline.config.schema import Condition, Platform, Settings, Subject, Treadmill
from pipeline.figures.residuals import axis_name
from pipeline.figures.style import COLOURS
from pipeline.trial.ground.laboratory import Laboratory, fit_calibration
from pipeline.trial.process import process_recording
from pipeline.trial.residuals import (
    AXES,
    UNITS,
    cycle_residuals,
    marker_rows,
    residual_table,
    threshold_rows,
)
from pipeline.viewer.trial import write_recording
from pipeline.virtual_lab.protocol.instrumented_treadmill import PLATFORM_MARKERS, make_treadmill
from pipeline.virtual_lab.protocol.walking_protocol import Protocol, Setting
from pipeline.virtual_lab.protocol.walking_trial import run_calibration, run_trial, study_subject

# %% [markdown]
# ## The trial, in order
#
# "In order" is not "perfect": skin moves, the body is not quite de Leva's, cells and cameras are
# noisy. That is what a good laboratory has, and what the grey curves in the picture show.

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
    platform=Platform(markers=tuple(PLATFORM_MARKERS)),
)
calibration = fit_calibration(empty, treadmill)
subject = Subject(id="sub01", sex="male", mass_kg=83.0, height_m=1.85)
walking = Condition(skip_s=setting.protocol.steady_s)


def process(recording=recording, subject=subject, settings=None, treadmill=treadmill):
    """Process the trial as stated, every time in the same way."""
    return process_recording(
        recording,
        subject,
        settings or Settings(),
        laboratory=Laboratory(treadmill, calibration),
        condition=walking,
    )


trials = {"in order": process()}

# %% [markdown]
# ## Five faults
#
# **A swapped marker.** For three seconds the left front and back pelvis markers carry each other's
# labels. And, in a trial of its own, so do knee and ankle of the right leg.

# %%
markers = recording.markers
hit = (markers.time > 22.0) & (markers.time < 25.0)


def swap(first, second):
    """Exchange two markers for three seconds."""
    pair = [markers.names.index(name) for name in (first, second)]
    position = markers.position.copy()
    position[np.ix_(hit, pair)] = position[np.ix_(hit, pair[::-1])]
    return replace(recording, markers=Markers(markers.time, markers.names, position))


swapped = swap("LASIS", "LPSIS")
trials["swapped pelvis"] = process(swapped)
trials["swapped leg"] = process(swap("RLEK", "RLM"))

# %% [markdown]
# **A delay of 30 ms.** The plates are late: two devices that were started by hand, or a filter in
# one of them.

# %%
late = tuple(replace(plate, time=plate.time + 0.03) for plate in recording.plates)
trials["plates 30 ms late"] = process(replace(recording, plates=late))

# %% [markdown]
# **A wrong mass.** Someone typed 73 for 83 kg.

# %%
trials["10 kg too light"] = process(subject=subject.model_copy(update={"mass_kg": 73.0}))

# %% [markdown]
# **No platform pose.** The plates tilt, but nobody told the software: their forces stay in the axes
# that they had in neutral.

# %%
trials["no platform pose"] = process(treadmill=treadmill.model_copy(update={"platform": None}))

# %% [markdown]
# **A dead accelerometer.** One channel, forward on the rear left sensor, is stuck.

# %%
analog = recording.analog
values = analog.values.copy()
channel = analog.names.index("rear_left.X")
values[:, channel] = values[0, channel]
trials["dead accelerometer"] = process(replace(recording, analog=replace(analog, values=values)))

# %% [markdown]
# ## What the numbers say

# %%
print(f"{'RMS':20s}", *(f"{axis:>7}" for axis in AXES), "  Hicks F, M   markers  delay")
for name, result in trials.items():
    table = residual_table(result, name)
    rms = table.loc[table["compensated"], "rms"]
    limits = pd.DataFrame(threshold_rows(result))
    peaks = limits[limits["compensated"]]
    share = " ".join(f"{v:4.1f}×" for v in peaks["peak"] / peaks["limit"])
    error = marker_rows(result)[-1].rms_mm
    print(
        f"{name:20s}",
        *(f"{value:7.1f}" for value in rms),
        f"  {share}  {error:4.1f} mm  {1000 * result.delay_s:5.1f} ms",
    )

# %% [markdown]
# And what the software itself says that it did not say of the trial in order:

# %%
usual = set(trials["in order"].notes)
for name, result in trials.items():
    for note in result.notes:
        if note not in usual:
            print(f"{name}: {note}")
print(pd.DataFrame(marker_rows(trials["swapped leg"])).nlargest(4, "peak_mm"))

# %% [markdown]
# ## What the viewer shows
#
# For a study, `hbm view results` opens it. Here we write one trial; open it with
# `rerun swapped_pelvis.rrd`.

# %%
write_recording(trials["swapped pelvis"], Path("swapped_pelvis.rrd"))

# %% [markdown]
# ## The picture
#
# One row per fault, one column per residual; every thin line is one gait cycle, grey for the
# trial in order. Each fault has a signature.
#
# **Swapped pelvis markers.** Stray cycles; all others lie on the grey. The pelvis jumps when the
# swap begins and when it ends, and the jump needs forces that nobody gave. So the *peaks* break
# the thresholds (6 and 14 times) while the RMS has moved far less. In the viewer: two of the marker
# errors rise together to 20 cm and fall again three seconds later; in the scene lines lead from
# these markers to where the model wants them, each to the other's place.
#
# **Swapped knee and ankle.** Nothing to see! Both pull along the shank, in opposite directions,
# and the fit stays where it was. Residuals do not find every fault: the marker errors do, half a
# metre here. Look at both.
#
# **Plates 30 ms late.** The same shape in every cycle, largest in Fx and Fz where the forces change
# fastest, after each foot strike and around push-off, and crossing zero: an early copy minus a late
# one. The software estimates the delay itself: 33 ms, of which 3 were there before. Give it back as
# `plate_delay_s`. In the viewer: residual arrows that flip with every step.
#
# **10 kg too light.** Fz keeps its shape and moves down by 98 N, ten kilograms' weight; the other
# forces hardly care. Down means that the ground carries more than the model weighs. In the viewer:
# an arrow at the pelvis that points down all the time, standing still as well.
#
# **No platform pose.** A fan: each cycle higher or lower than the last as the platform tilts. Fx
# up to a quarter of body weight, and My with it; more while the force is large. In the
# viewer: the plates stay level while the markers on the platform's rim go up and down.
#
# **Dead accelerometer.** The same fan, in the same residuals, because here the plates' own weight
# is left in. The notes tell them apart: the dead channel is named. And so does the shape. Without
# a pose the fan swells with the force under the feet; with a dead sensor it hardly
# cares about steps. In the viewer, the compensated curve is a smaller copy of the measured one.

# %%
shown = list(trials)[1:]
figure, panels = plt.subplots(
    len(shown), 6, figsize=(15, 2 * len(shown)), sharex=True, sharey="col", layout="constrained"
)
usual_curves = cycle_residuals(trials["in order"], "compensated")["right"]
for row, name in zip(panels, shown, strict=True):
    curves = cycle_residuals(trials[name], "compensated")["right"]
    for k, panel in enumerate(row):
        panel.plot(curves[..., k].T, color=COLOURS["measured"], lw=0.6)
        panel.plot(usual_curves[..., k].T, color="0.55", lw=0.4)
        panel.axhline(0, color="black", lw=0.5)
    row[0].set_ylabel(name)
for k in range(6):
    panels[0, k].set_title(f"{axis_name(k)}, {UNITS[k]}")
    panels[-1, k].set(xlabel="gait cycle (%)", xlim=(0, 100))
figure.suptitle(
    "Which fault looks how: every right gait cycle (vermilion) and the trial in order (grey)"
)
figure.savefig("05_reading_residuals.png", dpi=100)
