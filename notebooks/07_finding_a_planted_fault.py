# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Which fault did somebody plant?
#
# Somebody has tampered with a recording: the force plates are 12 ms later than the cameras, and one
# plate was not zeroed. We ask `hr.explain` for the causes of the residuals, do what it says to fix
# first, and see whether they fall as promised. On the command line: `hbm explain walk.c3d`.

# %%
from dataclasses import replace

import numpy as np

import hbm_residuals as hr

# %% [markdown]
# ## The recording
#
# A man walks for 20 s on a treadmill at rest. Noise is 0.5 mm on the markers and 0.5 N on the
# plates. Then the plates' clock is set back by 12 ms, and plate 1 gets a zero of 6 N forward and
# 8 N to the left.

# %%
hr.virtual_lab.simulate_trial("walk.c3d", duration_s=20.0, seed=1)
clean = hr.read("walk.c3d")
first, second = clean.plates
zero = np.array([6.0, 8.0, 0.0, 0.0, 0.0, 0.0])  # lab axes, N
own_axes = (zero.reshape(2, 3) @ first.rotation).ravel()
tampered = replace(
    clean,
    plates=(
        replace(first, time=first.time + 0.012, wrench_in_plate=first.wrench_in_plate + own_axes),
        replace(second, time=second.time + 0.012),
    ),
)
subject, laboratory = hr.Subject(sex="male"), hr.Laboratory(hr.Treadmill())
result = hr.process(tampered, subject, hr.Settings())
hr.figure(result)

# %% [markdown]
# ## Causes
#
# Every cause is a parameter with a usual size from the literature. The trial is computed again with
# each. The sizes are those that explain the mean gait cycle of all six residuals together. The
# lines say what to fix first, what this trial does not determine, and what causes estimated in one
# half of the gait cycles explain of the other half.

# %%
explanation = hr.explain(tampered, laboratory, result)
print(*explanation.lines(), sep="\n")

# %% [markdown]
# The delay is named first; its interval contains the planted 12 ms. The zeros are found too, in the
# plates' own axes: here, their x points to the left and their y forward. Each plate is unloaded
# while the other foot stands, and what it reads then is its zero.

# %%
for cause in explanation.budget.causes:
    if cause.name.endswith(("zero of Fx", "zero of Fy")):
        print(f"{cause.name}: {cause.size:.1f} ± {1.96 * cause.deviation:.1f} {cause.unit}")

# %% [markdown]
# ## Doing what it says
#
# We set the delay that was found, process the trial again, and compare with the promise. The zero
# remains: it is corrected by zeroing the plate.

# %%
(delay,) = (cause for cause in explanation.budget.causes if cause.name == "plates delayed")
corrected = hr.process(tampered, subject, hr.Settings(plate_delay_s=round(delay.size, 3)))
now = hr.residuals(corrected, "corrected")["rms"]
for axis, before, promised, after in zip(
    ("Fx", "Fy", "Fz", "Mx", "My", "Mz"), explanation.budget.rms, delay.left, now, strict=True
):
    print(f"{axis}: RMS {before:6.2f}, promised {promised:6.2f}, now {after:6.2f}")

# %%
figure = hr.figure(corrected)
figure.savefig("07_finding_a_planted_fault.png", dpi=100)
figure
