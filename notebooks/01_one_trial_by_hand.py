# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # One trial, step by step
#
# A man walks on a level treadmill. Cameras record 46 markers, two force plates the ground reaction.
# We go from the file to the pelvis residuals one step at a time. `pipeline.process_recording` does
# the same, and more, in one call.
#
# **The principle.** From the motion and mass of every segment follow the force and moment that the
# ground must exert. The plates measure the force and moment that it did exert. The difference is
# the *residual*. With perfect measurements and a perfect model it is zero.

# %%
import matplotlib.pyplot as plt
import numpy as np

import hbm
import pipeline
from hbm.signals.filtering import butterworth
from hbm.signals.resampling import resample
from pipeline.figures.residuals import label_panels
from pipeline.figures.style import COLOURS, draw_band
from pipeline.trial.gait.contact import FEET, by_foot, feet_of, share_between_feet
from pipeline.trial.gait.cycles import gait_cycles, normalise
from pipeline.trial.gait.events import gait_events
from pipeline.trial.residuals import AXES, reported
from pipeline.virtual_lab.protocol.walking_trial import simulate_trial

# %% [markdown]
# ## 1. A recording
#
# The virtual laboratory writes a C3D file like any other. Noise is 0.5 mm on the markers and 0.5 N
# on the plates; the body is exactly the one that the model assumes, and there is no soft-tissue
# motion.

# %%
simulate_trial("walk.c3d", duration_s=25.0, speed_mps=1.3)
trial = pipeline.read_c3d("walk.c3d")
print(f"{len(trial.markers.names)} markers at {trial.markers.rate_hz:g} Hz,", end=" ")
print(f"{len(trial.plates)} plates, {trial.markers.time[-1]:.1f} s")
print(*trial.notes, sep="\n")

# %% [markdown]
# ## 2. A body
#
# The recording begins with a T-pose. Joint centres, axes and segment lengths are taken from it;
# segment masses and moments of inertia follow from body mass, sex and lengths (de Leva 1996).

# %%
body = hbm.build_body(trial.markers, mass=trial.metadata.mass_kg, sex="male")
print(f"{body.mass:.1f} kg, {body.height_m:.2f} m, marker set {body.marker_set.name}")

# %% [markdown]
# ## 3. A motion
#
# In every frame, inverse kinematics finds the 46 coordinates that bring the model's markers closest
# to the measured ones. The filter also gives velocities and accelerations.

# %%
raw = hbm.solve_ik(body, trial.markers)
motion = hbm.filter_motion(raw, cutoff=6.0, method="zero_phase")
print(f"marker error {1000 * np.sqrt(np.mean(raw.marker_error**2)):.2f} mm RMS")

# %% [markdown]
# ## 4. Forces under the feet
#
# Each plate's wrench is resampled at the markers' times, assigned to the foot on that plate, and
# filtered like the motion. A different filter would add residuals of its own.

# %%
plates = [resample(plate.time, plate.wrench, motion.time) for plate in trial.plates]
shared = share_between_feet(motion.time, plates, feet_of(body, raw), threshold_n=20.0)
under = by_foot(np.stack(plates, axis=1), shared.on)
ground = {
    foot: butterworth(under[:, k], motion.time, 6.0, "zero_phase").value
    for k, foot in enumerate(FEET)
}

# %% [markdown]
# ## 5. The equations of motion

# %%
dynamics = hbm.inverse_dynamics(body, motion, ground)
measured = sum(ground.values())
required = measured + dynamics.residual  # forces only: the moments have different reference points

# %% [markdown]
# ## 6. Over the gait cycle

# %%
events, which = gait_events(trial.events, trial.markers, body.marker_set)
cycles, _ = gait_cycles(events, "right")
cycles = cycles[cycles[:, 0] > 8.0]  # at constant belt speed
curves = normalise(motion.time, reported(dynamics.residual), cycles)
rms = np.sqrt(np.mean(curves**2, axis=(0, 1)))
print(which)
print(f"{len(cycles)} cycles of the right foot; RMS residuals:")
print(*(f"{name} {value:.2f}" for name, value in zip(AXES, rms, strict=True)))

# %% [markdown]
# ## The picture
#
# Top: the vertical force measured by the plates (vermilion) and the one required by the motion
# (black, dashed). Below: their difference in all six components, a few newtons and about one newton
# metre.
#
# **What to notice.** The residuals oscillate a few times per step, mostly because of the filter: it
# is applied to angles on one side of the equations of motion and to forces on the other, and the
# equations are nonlinear. Simulate the trial again with `marker_noise_m=0, plate_noise_n=0`, and
# most of the oscillation in Fz remains; with both cut-offs at 12 Hz as well, about an eighth of it.
# With real noise, a higher cut-off would let the noise through instead. A real subject also differs
# from the model: notebook 05 shows what such errors look like.

# %%
percent = np.arange(101)
figure = plt.figure(figsize=(10, 8), layout="constrained")
grid = figure.add_gridspec(3, 3, height_ratios=(1.3, 1, 1))
above = figure.add_subplot(grid[0, :])
for foot, style in (("right_foot", "-"), ("left_foot", ":")):
    mean = normalise(motion.time, ground[foot][:, 2], cycles).mean(axis=0)
    above.plot(percent, mean, style, color="grey", label=foot.replace("_", " "))
for label, force, line in (
    ("both feet, measured", measured, {"color": COLOURS["measured"], "lw": 3}),
    ("required by the motion", required, {"color": "black", "ls": "--"}),
):
    above.plot(
        percent, normalise(motion.time, force[:, 2], cycles).mean(axis=0), label=label, **line
    )
above.set(title="vertical force", ylabel="N", xlim=(0, 100))
above.legend(ncols=2, frameon=False)
panels = [figure.add_subplot(grid[1 + k // 3, k % 3]) for k in range(6)]
for k, panel in enumerate(panels):
    mean, spread = curves[..., k].mean(axis=0), curves[..., k].std(axis=0)
    draw_band(panel, percent, mean, spread, COLOURS["compensated"])
label_panels(panels)
figure.suptitle("Measured force, force required by the motion, and the residuals between them")
figure.savefig("01_one_trial_by_hand.png", dpi=100)
