# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Another design: two treadmills
#
# Experiment 3 is one design among many. Here six people walk on two treadmills that stand still: a
# new one, and an old one with noisy load cells. Are the residuals on the old one still at the level
# of the new one?
#
# Shoes, filters of the cameras, or before and after a training are studied in the same way: their
# names are the conditions of the study, and nothing else changes.

# %%
from pathlib import Path

from pipeline.config.comparison import study_design
from pipeline.config.study import read_study
from pipeline.report.figures import marginal_means_figure
from pipeline.report.tables import plan_markdown
from pipeline.run.load import collect
from pipeline.run.run import run_study
from pipeline.statistics.comparison import statistics
from pipeline.statistics.table_3 import table_3, table_3_markdown
from pipeline.statistics.verdict import headlines, verdicts
from pipeline.virtual_lab.protocol.walking_protocol import PERSONS
from pipeline.virtual_lab.protocol.walking_trial import simulate_trial

# %% [markdown]
# ## 1. Recordings
#
# Simulated, of course: 14 seconds of standing and walking each. The plates of the new treadmill
# have a noise of 0.5 N, those of the old one of 12 N, of which the low-pass filter lets a sixth
# pass. All else is ideal, also the body, which is the one that the model assumes: residuals are far
# below those of notebook 04, and noise shows that would be lost there.

# %%
NOISE_N = {"new": 0.5, "old": 12.0}
folder = Path("treadmills")
folder.mkdir(exist_ok=True)
people = PERSONS[:6]
for number, person in enumerate(people):
    for walk, (treadmill, noise_n) in enumerate(NOISE_N.items()):
        simulate_trial(
            folder / f"{person.name}_{treadmill}.c3d",
            person=person,
            duration_s=14.0,
            seed=10 * number + walk,
            plate_noise_n=noise_n,
        )

# %% [markdown]
# ## 2. The study, all of it
#
# This text is everything that makes a comparison of treadmills out of the recordings. Without
# `[comparison]`, the conditions would be compared in the order in which they stand, the first as
# reference.
#
# There is no calibration, so there is nothing to compensate and the design has one factor. With
# `calibration` under `[treadmill]`, compensation would be a second one.

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
"""
(folder / "study.toml").write_text(STUDY, encoding="utf-8")
for person in people:
    trials = "".join(
        f'[trials.{treadmill}]\nfile = "{person.name}_{treadmill}.c3d"\n' for treadmill in NOISE_N
    )
    about = f'id = "{person.name}"\nsex = "{person.sex}"\nheight_m = {person.height_m}\n'
    (folder / f"{person.name}.toml").write_text(about + trials, encoding="utf-8")

# %% [markdown]
# ## 3. Residuals and statistics
#
# What follows is what `hbm run treadmills` and `hbm report results --plan` do.

# %%
study = read_study(folder)
for outcome in run_study(study, Path("results"), jobs=2):
    print(outcome.job.name, outcome.state, outcome.reason)

# %%
design, results = study_design(study.file), collect(Path("results"))
tests = statistics(results.residuals, results.subjects, design)
print(table_3_markdown(table_3(results.residuals, tests, design), design))

# %% [markdown]
# With two levels there is one pair, whose t-test and Wilcoxon test are in the table, and an F test
# with one degree of freedom, which is the square of t. The verdict asks another question than these
# tests: not whether the treadmills differ, but whether the old one is at most the margin above the
# new one. The plan tells how many subjects would show it.

# %%
found = verdicts(results.residuals, design)
print(*headlines(found, design), sep="\n")
print(plan_markdown(found, design))

# %% [markdown]
# ## The picture
#
# Each panel is one residual on both treadmills: mean and 95 % confidence interval, with a thin line
# for each person. All six rise on average, and four of the differences are significant. Still, the
# forces rise by a fifth at most, as noise adds to a residual in squares, while the moments about x
# and y, which are small on the new treadmill, rise by half and more. A difference may be
# significant and small: the margin says what matters.

# %%
figure = marginal_means_figure(results.residuals, tests, design)
figure.savefig("06_another_design.png", dpi=100)
