# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Does compensation return the residuals to their level on a treadmill at rest?
#
# The main question of this project, experiment 3: a treadmill sways or pitches under a walking
# subject. Here with three simulated subjects and short trials, from the files to the statistics.
# `hbm demo` does the same with nine subjects; `hbm demo --full` simulates the thesis' protocol, 2.4
# hours of walking.

# %%
import matplotlib.pyplot as plt

import hbm_residuals as hr

lab = hr.virtual_lab

# %% [markdown]
# ## 1. A study is a folder
#
# `study.toml` describes the laboratory and the settings. One TOML file per subject describes the
# subject and the trials. There are recordings of the empty treadmill, of people beside a plate that
# stays empty, and three per subject.

# %%
small = lab.Protocol(subjects=3, baseline_s=20.0, pitch_s=35.0, waits_s=(12.0, 12.0))
folder = lab.simulate_study("study", lab.Setting(protocol=small))
print(*sorted(path.name for path in folder.iterdir()), sep="\n")

# %% [markdown]
# ## 2. Every trial, with and without compensation
#
# Finished trials are kept, so the same call continues an interrupted run. The report has tables,
# statistics, figures, a page per trial and a paragraph for the Methods section.

# %%
for outcome in hr.run(hr.read_study(folder), "results", jobs=2):
    print(outcome.job.name, outcome.state, outcome.reason)
page = hr.report("results", folder)
print(f"report: {page}")

# %% [markdown]
# ## 3. Statistics
#
# Two factors within subjects: compensation (no IC, IC) and condition (baseline, sway, pitch). The
# table has the layout of Table III of the thesis.

# %%
print((page.parent / "table_3.md").read_text(encoding="utf-8"))

# %% [markdown]
# ## The pictures
#
# Every panel is one residual: its RMS in the three conditions, without (vermilion squares) and with
# (blue circles) compensation, mean and 95 % confidence interval, with a thin line for each subject,
# on logarithmic axes. In the second figure, lines are the RMS over gait cycles at each percent of
# the cycle; colours mean compensation, line styles conditions.
#
# Without compensation, sway affects Fy, Mx and Mz, and pitch Fx, My, Fz and Mz. With compensation,
# the residuals are those of a treadmill at rest. They come from body, soft tissue and markers,
# which no compensation of plates can remove.
#
# Three subjects show how the analysis works but prove nothing: a Wilcoxon test with three pairs
# cannot become significant.


# %%
def show(name):
    """Show a figure of the report."""
    figure, panel = plt.subplots(figsize=(11, 7), layout="constrained")
    panel.imshow(plt.imread(page.parent / "figures" / f"{name}.png"))
    panel.axis("off")
    return figure


show("marginal_means")

# %%
show("gait_cycle_sway")
