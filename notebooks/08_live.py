# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Are residuals while the subject walks those of the trial?
#
# `hbm live` computes residuals frame by frame, from streams of Lab Streaming Layer or Qualisys.
# Here we rehearse without a network: a recording is replayed as streams into the same chain. We
# compare it with the trial processed afterwards, then spoil the streams and watch what is said.

# %%
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import pipeline
from hbm.markers import Markers
from pipeline.config.live import Live
from pipeline.config.schema import Treadmill
from pipeline.live.chain import LiveChain
from pipeline.live.monitor import Monitor
from pipeline.live.replay import RecordedSource
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.residuals import AXES, UNITS, reported
from pipeline.virtual_lab.protocol.walking_trial import simulate_trial

# %% [markdown]
# ## A trial, processed afterwards
#
# With `filter = "realtime"` no number of a trial waits for a later one, as in a laboratory: values
# are 38 ms late by the filter. That is the reference.

# %%
simulate_trial("walk.c3d", duration_s=30.0, seed=2)
walk = pipeline.read_c3d("walk.c3d")
subject, settings = pipeline.Subject(sex="male"), pipeline.Settings(filter="realtime")
result = pipeline.process_recording(walk, subject, settings)
offline = reported(result.measured.residual)

# %% [markdown]
# ## The same trial, frame by frame
#
# `RecordedSource` gives the recording in chunks of 10 ms, as it would arrive. The chain takes them
# and gives every frame as soon as its last sample is there.


# %%
def follow(recording):
    """Replay a recording; gives its frames and the monitor that watched them."""
    source = RecordedSource(recording)
    laboratory = Laboratory(Treadmill())
    chain = LiveChain(result.body, laboratory, settings, Live(), source.streams, recording.plates)
    monitor, frames = Monitor(chain, recording.plates), []
    while not source.ended:
        for samples in source.receive(0.0):
            monitor.samples(samples)
            for frame in chain.push(samples):
                monitor.frame(frame, frame.computing_s)
                frames.append(frame)
    return frames, monitor


frames, monitor = follow(walk)
live = np.array([frame.residual["measured"] for frame in frames])
in_time = np.array([frame.quality.counts for frame in frames])
largest = np.abs(live - offline[: len(live)])[in_time].max()
print(f"{in_time.sum()} of {len(frames)} frames used; largest difference {largest:.1e} N or N·m")
print(monitor.status())

# %% [markdown]
# ## Spoilt streams
#
# A marker is gone for four seconds, one plate reads 15 N too much, and both plates are 15 ms late.
# In a laboratory, these lines appear while the subject is still there.

# %%
position = walk.markers.position.copy()
position[1500:1900, walk.markers.names.index("LASIS")] = np.nan
first, second = walk.plates
zero = (np.array([0, 0, 15.0, 0, 0, 0]).reshape(2, 3) @ first.rotation).ravel()
spoilt = replace(
    walk,
    markers=Markers(walk.markers.time, walk.markers.names, position),
    plates=(
        replace(first, time=first.time + 0.015, wrench_in_plate=first.wrench_in_plate + zero),
        replace(second, time=second.time + 0.015),
    ),
)
spoilt_frames, spoilt_monitor = follow(spoilt)
for time, note in spoilt_monitor.notes:
    print(f"{time:5.1f} s: {note}")

# %% [markdown]
# ## The picture
#
# The residual of every gait cycle as it ended: thin lines are cycles, and their root mean square is
# in the title. What the plates' delay and zero do is there after the second step.

# %%
figure, panels = plt.subplots(2, 3, figsize=(11, 6), sharex=True)
for k, panel in enumerate(panels.flat):
    for cycles, colour in ((monitor.cycles, "#0072B2"), (spoilt_monitor.cycles, "#D55E00")):
        for cycle in cycles:
            panel.plot(cycle.curve["measured"][:, k], color=colour, linewidth=0.8, alpha=0.7)
    rms = [each.condition.rms["measured"][k] for each in (monitor, spoilt_monitor)]
    panel.set_title(f"{AXES[k]}: RMS {rms[0]:.1f}, spoilt {rms[1]:.1f} {UNITS[k]}")
    panel.axhline(0, color="0.7", linewidth=0.6, zorder=0)
for panel in panels[1]:
    panel.set_xlabel("gait cycle (%)")
figure.suptitle("The last ten gait cycles, as recorded (blue) and spoilt (vermilion)")
figure.tight_layout()
figure.savefig("08_live.png", dpi=100)
