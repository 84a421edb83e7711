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
# The main question of this project: when a treadmill sways or pitches under a walking subject, does
# inertia compensation return the pelvis residuals to their values on a level, stationary treadmill?
#
# Here with three simulated subjects and short trials, from the files to the statistics. `hbm demo`
# does the same with nine subjects and adds a report and a viewer recording; `hbm demo --full`
# simulates the thesis' protocol, 2.4 hours of walking.

# %%
from pathlib import Path

from pipeline.config.study import read_study
from pipeline.report.figures import marginal_means_figure
from pipeline.run.load import collect
from pipeline.run.run import run_study
from pipeline.statistics.comparison import statistics
from pipeline.statistics.design import EXPERIMENT_3
from pipeline.statistics.table_3 import table_3, table_3_markdown
from pipeline.virtual_lab.protocol.walking_protocol import Protocol, Setting
from pipeline.virtual_lab.protocol.walking_study import simulate_study

# %% [markdown]
# ## 1. A study is a folder
#
# `study.toml` describes the laboratory and the settings, one TOML file per subject describes the
# subject and the trials, and there are the recordings: one of the empty treadmill, five of people
# beside a plate that stays empty, and three per subject.

# %%
small = Protocol(subjects=3, baseline_s=20.0, pitch_s=35.0, waits_s=(12.0, 12.0))
folder = simulate_study(Path("study"), Setting(protocol=small))
print(*sorted(path.name for path in folder.iterdir()), sep="\n")
print((folder / "study.toml").read_text(encoding="utf-8"))

# %% [markdown]
# ## 2. Every trial, with and without compensation
#
# Finished trials are skipped, so the same call continues a run that was interrupted.

# %%
for outcome in run_study(read_study(folder), Path("results"), jobs=2):
    print(outcome.job.name, outcome.state, outcome.reason)

# %% [markdown]
# ## 3. Statistics
#
# Two within-subject factors: compensation (no IC, IC) and condition (baseline, sway, pitch). The
# table has the layout of Table III of the thesis. `hbm report results` writes everything, with
# figures and a paragraph for the Methods section, as one page.

# %%
results = collect(Path("results"))
residuals = results.residuals[results.residuals["headline"]]
tests = statistics(residuals, results.subjects)
print(table_3_markdown(table_3(residuals, tests)))

# %% [markdown]
# ## The picture
#
# Every panel is one residual: its RMS in the three conditions, without (dashed) and with (solid)
# compensation, mean and 95 % confidence interval over three subjects, with a thin line for each.
# Without compensation, sway affects Fy, Mx and Mz, and pitch Fx, My, Fz and Mz. With compensation
# (blue), the lines are nearly level: the residuals are those of a stationary treadmill, 8 to 23 N
# and 3 to 11 N·m. They come from body, soft tissue and markers, and no compensation of the plates
# can remove them. Not all of the differences that are left are the compensation's: on a slope a
# wrong body adds more than on the level (Fx and Fz in pitch), and in sway only the part of the gait
# cycle counts in which the platform moves. Compensation lowers Mx and Fy at baseline too: it also
# takes away the zeros of the plates.
# Lines that diverge in one condition only are an interaction in the ANOVA.
#
# Three subjects show how the analysis works but prove nothing: a Wilcoxon test with three pairs
# cannot become significant, however large the effect (the column of 1.000 in the table).

# %%
figure = marginal_means_figure(residuals, tests, EXPERIMENT_3)
figure.savefig("04_experiment_3.png", dpi=100)
