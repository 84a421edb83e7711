# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Are the residuals on an old treadmill at the level of a new one?
#
# Experiment 3 is one design among many. Here six people walk three times on each of two treadmills
# at rest: a new one, and an old one with noisy load cells. One recording is lost. Does the answer
# depend on the filter?
#
# Shoes, or before and after a training, are studied in the same way: their names are the conditions
# of the study. Copy the two texts below.

# %%
from pathlib import Path

import pandas as pd

import hbm_residuals as hr

lab = hr.virtual_lab

# %% [markdown]
# ## 1. Recordings
#
# Simulated: 14 seconds of standing and walking each. The plates of the new treadmill have a noise
# of 0.5 N, those of the old one of 12 N. All else is ideal, so that residuals are far below those
# of notebook 04.

# %%
NOISE_N = {"new": 0.5, "old": 12.0}
folder = Path("treadmills")
folder.mkdir(exist_ok=True)
people = lab.PERSONS[:6]
for number, person in enumerate(people):
    for seed in range(6):
        treadmill = ("new", "old")[seed % 2]
        lab.simulate_trial(
            folder / f"{person.name}_{treadmill}_{seed // 2}.c3d",
            person=person,
            duration_s=14.0,
            seed=10 * number + seed,
            plate_noise_n=NOISE_N[treadmill],
        )

# %% [markdown]
# ## 2. The study, all of it
#
# One text for the study. There is no calibration of the treadmills, so there is nothing to
# compensate. Without `[comparison]`, the conditions would be compared in the order in which they
# stand, the first as reference. `[variants]` names another way of processing.

# %%
STUDY = """\
name = "Two treadmills"

[conditions.old]
skip_s = 6.0  # the T-pose and the start of the belts
[conditions.new]
skip_s = 6.0

[comparison]
factor = "treadmill"
levels = ["new", "old"]
reference = "new"
covariates = ["mass_kg"]
margin = 0.2  # at most a fifth more than on the new treadmill

[variants.cutoff_12]
cutoff_hz = 12
"""
(folder / "study.toml").write_text(STUDY, encoding="utf-8")

# %% [markdown]
# And one for each person. `files` lists the recordings of a condition; one of the last person's is
# not there.

# %%
for person in people:
    files = {t: [f"{person.name}_{t}_{k}.c3d" for k in range(3)] for t in NOISE_N}
    if person is people[-1]:
        del files["old"][1]
    trials = "".join(f"[trials.{t}]\nfiles = {list(own)}\n" for t, own in files.items())
    about = f'id = "{person.name}"\nsex = "{person.sex}"\nheight_m = {person.height_m}\n'
    (folder / f"{person.name}.toml").write_text(about + trials, encoding="utf-8")
print(about + trials)

# %% [markdown]
# ## 3. Residuals and statistics
#
# What follows is what `hbm run treadmills` and `hbm report` do. The report is a page for the
# browser; its tables are files, and `columns.csv` says what each column is.

# %%
results = Path("results")
outcomes = list(hr.run(hr.read_study(folder), results, jobs=2))
page = hr.report(results, folder)
print(f"{len(outcomes)} recordings, {sum(o.failure is None for o in outcomes)} done; {page}")

# %%
rms = pd.read_csv(results / "residuals.csv").query("headline")
rms = rms.pivot_table(index="axis", columns="condition", values="rms")
rms.plot.bar(ylabel="mean RMS (N, N·m)", rot=0, title="Residuals on the two treadmills")

# %%
tests = pd.read_csv(results / "statistics.csv")
tests = tests.query("test == 'mixed model' and correction == 'Bonferroni x1'")
tests[["axis", "effect_size", "ci_low", "ci_high", "p_corrected", "n", "note"]].round(3)

# %% [markdown]
# The mixed models use all 35 recordings. The treadmills differ significantly in all six residuals.
# The verdict of the report asks another question: whether the old one is at most the margin above
# the new one. The plan tells how many people would show it, with how many recordings each.

# %%
print((results / "plan.md").read_text(encoding="utf-8"))

# %% [markdown]
# At which part of the gait cycle do they differ? Curves are compared by the same 35 recordings. In
# 95 % of studies the band holds the true difference at every instant together.

# %%
bands = pd.read_csv(results / "curve_bands.csv").query("curve == 'Fz'").set_index("percent")
panel = bands["difference"].plot(
    title=f"RMS Fz, {bands['compared'].iloc[0]}", xlabel="gait cycle (%)", ylabel="N"
)
panel.fill_between(bands.index, bands["low"], bands["high"], alpha=0.3)
panel.axhline(0, color="black", lw=0.5)
print(f"p < 0.05 in {(bands['p'] < 0.05).mean():.0%} of the gait cycle")

# %% [markdown]
# How well do the residuals repeat? A change of one person between two recordings that is above
# `smallest_detectable_change` is more than scatter.

# %%
repeated = pd.read_csv(results / "reliability.csv").query("name in ['Fx', 'Fz', 'My']")
repeated[["condition", "name", "mean", "sd_within", "icc", "smallest_detectable_change"]].round(2)

# %% [markdown]
# And the filter? `variants.csv` has each residual of each person by either way of processing.

# %%
variants = pd.read_csv(results / "variants.csv")
of_variants = variants.pivot_table(index="axis", columns=["variant", "condition"], values="rms")
panel = of_variants.plot.bar(ylabel="mean RMS (N, N·m)", rot=0, title="The same with two filters")
panel.figure.savefig("06_another_design.png", dpi=100)
