# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Experiment 3
#
# The question of the whole project: when a treadmill sways or pitches under a walking person, does
# inertia compensation bring the pelvis residuals back to what they are when it stands still?
#
# Here with three virtual people and short trials, from their files to the statistics. What `hbm
# demo` does with a report and a viewer, and `hbm demo --full` with nine people and 2.4 hours of
# walking.

# %%
from pathlib import Path

from pipeline.config.study import read_study
from pipeline.report.figures import marginal_means_figure
from pipeline.run.load import collect
from pipeline.run.run import run_study
from pipeline.statistics.comparison import statistics
from pipeline.statistics.table_3 import table_3, table_3_markdown
from pipeline.virtual_lab.protocol.walking_protocol import Protocol, Setting
from pipeline.virtual_lab.protocol.walking_study import simulate_study

# %% [markdown]
# ## 1. A study is a folder
#
# `study.toml` says how it was recorded and how to process it, one more TOML file per person says
# who and which trials, and there are the recordings: one of the empty treadmill, three per person.

# %%
small = Protocol(subjects=3, baseline_s=20.0, pitch_s=35.0, waits_s=(12.0, 12.0))
folder = simulate_study(Path("study"), Setting(protocol=small))
print(*sorted(path.name for path in folder.iterdir()), sep="\n")
print((folder / "study.toml").read_text(encoding="utf-8"))

# %% [markdown]
# ## 2. Every trial, with and without compensation
#
# What is done already is not done again, so the same line continues a run that was interrupted.

# %%
for outcome in run_study(read_study(folder), Path("results"), jobs=2):
    print(outcome.job.subject, outcome.job.condition, outcome.state, outcome.reason)

# %% [markdown]
# ## 3. Statistics
#
# Two factors, repeated over people: compensation (no IC, IC) and condition (baseline, sway,
# pitch). The table is laid out as the thesis' Table III. `hbm report results` writes all of it,
# with figures and a paragraph of methods, as one page.

# %%
results = collect(Path("results"))
tests = statistics(results.residuals, results.subjects)
print(table_3_markdown(table_3(results.residuals, tests)))

# %% [markdown]
# ## The picture
#
# Every panel is one residual: its RMS in the three conditions, without (dashed) and with (solid)
# compensation, mean and 95 % confidence interval over three people, each of them as a thin line.
# Without compensation, sway shows in Fy, Mx and Mz and pitch in Fx, My and Fz. With it, the blue
# line is nearly level: the residuals are what they are on a treadmill that stands still, ten
# newtons or so, which no compensation of the plates removes, for they come from body and markers.
# That lines part in one condition only is what the ANOVA calls an interaction.
#
# Three people show how it works, not that it is so: a Wilcoxon test with three pairs cannot become
# significant however large the effect, as the table's column of 1.000 says.

# %%
figure = marginal_means_figure(results.residuals, tests)
figure.savefig("04_experiment_3.png", dpi=100)
