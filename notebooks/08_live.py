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

import hbm_residuals as hr

# %% [markdown]
# ## A trial, processed afterwards
#
# With `filter = "realtime"` no number of a trial waits for a later one, as in a laboratory: values
# are 38 ms late by the filter. That is the reference.

# %%
hr.virtual_lab.simulate_trial("walk.c3d", duration_s=30.0, seed=2)
settings = hr.Settings(filter="realtime")
result = hr.process(hr.read("walk.c3d"), hr.Subject(sex="male"), settings)
table = hr.residuals(result, "walking")

# %% [markdown]
# ## The same trial, frame by frame
#
# `hr.rehearse` gives the recording to the chain in chunks of 10 ms, as it would arrive. Every frame
# is computed as soon as its last sample is there.

# %%
frames, monitor = hr.rehearse(hr.read("walk.c3d"), result.body, settings)
print(monitor.status())
used = [frame for frame in frames if frame.quality.counts]
after = result.measured.tau[result.motion.time.searchsorted([f.time - 1e-6 for f in used])]
largest = max(abs(f.tau["measured"] - tau).max() for f, tau in zip(used, after, strict=True))
print(f"{len(used)} of {len(frames)} frames used; largest difference {largest:.1e} N or N·m")


def show(monitor, title, colour):
    """Draw the residual of each of the last ten gait cycles, and the mean square so far."""
    figure, panels = plt.subplots(2, 3, figsize=(11, 5), sharex=True, layout="constrained")
    for k, panel in enumerate(panels.flat):
        for cycle in monitor.cycles:
            panel.plot(cycle.curve["measured"][:, k], color=colour, lw=0.8, alpha=0.7)
        axis, unit = table["axis"][k], table["unit"][k]
        rms = monitor.condition.rms["measured"][k]
        panel.set_title(f"{axis}: RMS {rms:.1f} {unit} (trial {table['rms'][k]:.1f})")
        panel.axhline(0, color="0.7", lw=0.6, zorder=0)
    for panel in panels[1]:
        panel.set_xlabel("gait cycle (%)")
    figure.suptitle(title)
    return figure


show(monitor, "The last ten gait cycles, as recorded", "#0072B2")

# %% [markdown]
# ## Faulty streams
#
# A marker is hidden for four seconds, one plate reads 15 N too much, and both plates are 15 ms
# late. In a laboratory, these lines appear while the subject is still there.

# %%
walk = hr.read("walk.c3d")
position = walk.markers.position.copy()
position[1500:1900, walk.markers.names.index("LASIS")] = float("nan")
first, second = (replace(plate, time=plate.time + 0.015) for plate in walk.plates)
wrench = first.wrench_in_plate.copy()
wrench[:, :3] += 15.0 * first.rotation[2]  # upwards
faulty = replace(
    walk,
    markers=replace(walk.markers, position=position),
    plates=(replace(first, wrench_in_plate=wrench), second),
)
_, monitor = hr.rehearse(faulty, result.body, settings)
for time, note in monitor.notes:
    print(f"{time:5.1f} s: {note}")

# %%
figure = show(monitor, "The last ten gait cycles with the faults", "#D55E00")
figure.savefig("08_live.png", dpi=100)
