# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # What lies between a recording and a residual?
#
# A man walks on a level treadmill. Cameras record 46 markers, two force plates the ground reaction.
# We go from the file to the pelvis residuals one step at a time. `hr.process` does the same, and
# more, in one call.
#
# **The principle.** Motion and mass of every segment require a force and a moment from the ground.
# The plates measure the force and moment that acted. The difference is the *residual*. With perfect
# measurements and a perfect model it is zero.

# %%
import matplotlib.pyplot as plt

import hbm
import hbm_residuals as hr

# %% [markdown]
# ## 1. A recording
#
# The virtual laboratory writes a C3D file like any other. Noise is 0.5 mm on the markers and 0.5 N
# on the plates; the body is the one that the model assumes.

# %%
hr.virtual_lab.simulate_trial("walk.c3d", duration_s=25.0, speed_mps=1.3)
recording = hr.read("walk.c3d")
markers = recording.markers
print(f"{len(markers.names)} markers at {markers.rate_hz:g} Hz, {len(recording.plates)} plates")

# %% [markdown]
# ## 2. A body
#
# The recording begins with a T-pose. It gives joint centres, axes and segment lengths. Segment
# masses and moments of inertia follow from body mass, sex and lengths (de Leva 1996).

# %%
body = hbm.build_body(markers, mass=recording.metadata.mass_kg, sex="male")
print(f"{body.mass:.1f} kg, {body.height_m:.2f} m, marker set {body.marker_set.name}")

# %% [markdown]
# ## 3. A motion
#
# In every frame, inverse kinematics finds the 46 coordinates that bring the model's markers closest
# to the measured ones. The filter also gives velocities and accelerations.

# %%
motion = hbm.filter_motion(hbm.solve_ik(body, markers), cutoff=6.0, method="zero_phase")
figure, panel = plt.subplots(figsize=(8, 3), layout="constrained")
for joint in ("RHipFlexion", "RKneeFlexion", "RAnklePlantarFlexion"):
    panel.plot(motion.time, motion.coordinate(joint), label=joint)
panel.set(xlim=(10, 14), xlabel="time (s)", ylabel="angle (rad)", title="Joint angles")
panel.legend(frameon=False, ncols=3)

# %% [markdown]
# ## 4. Forces under the feet, and the equations of motion
#
# `hr.process` assigns each plate's wrench to the foot on it and filters it like the motion. With
# these wrenches, inverse dynamics gives joint moments and the residual. Ours are those of
# `hr.process`, to rounding.

# %%
result = hr.process(recording, hr.Subject(sex="male"), hr.Settings())
ground = result.ground["measured"]
dynamics = hbm.inverse_dynamics(body, motion, ground)
difference = abs(dynamics.residual - result.measured.residual)[result.counts].max()
print(f"largest difference from hr.process: {difference:.1e} N or N·m")

# %%
measured = ground["left_foot"] + ground["right_foot"]
required = measured + dynamics.residual  # forces only: moments are about other points
figure, panel = plt.subplots(figsize=(8, 3), layout="constrained")
panel.plot(motion.time, measured[:, 2], color="#D55E00", lw=3, label="measured by the plates")
panel.plot(motion.time, required[:, 2], color="black", ls="--", label="required by the motion")
panel.set(xlim=(10, 14), xlabel="time (s)", ylabel="N", title="Vertical force")
panel.legend(frameon=False, ncols=2)

# %% [markdown]
# ## 5. The residuals
#
# A few newtons and about one newton metre remain. They oscillate a few times per step, mostly
# because of the filter: it is applied to angles on one side of the equations and to forces on the
# other, and the equations are nonlinear. A real subject differs from the model, too: notebook 05
# shows what errors look like.

# %%
table = hr.residuals(result, "walking")
print(table[["axis", "unit", "rms", "peak", "n_cycles"]].round(2).to_string(index=False))
figure = hr.figure(result)
figure.savefig("01_one_trial_by_hand.png", dpi=100)
figure
