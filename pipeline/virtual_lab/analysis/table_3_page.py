"""The page that puts the thesis' Table III beside simulated ones, and says why they differ."""

from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from importlib.resources import files
from typing import Final

import numpy as np
import pandas as pd

from hbm.signals.filtering import low_pass
from hbm.spatial import GRAVITY_MPS2
from pipeline.trial.residuals import AXES, UNIT_OF, UNITS
from pipeline.virtual_lab.analysis.page_table import markdown
from pipeline.virtual_lab.analysis.printed_table_3 import printed_cells, removed
from pipeline.virtual_lab.analysis.processed_study import LENGTHS_S, PERTURBED
from pipeline.virtual_lab.analysis.reproduction import (
    AS_IS,
    DOCUMENTED,
    ESTIMATED,
    ITEMS,
    LABORATORIES,
    Reproduction,
    compared,
)
from pipeline.virtual_lab.analysis.unstated_page import unstated_parts
from pipeline.virtual_lab.machine.actuators import move_platform
from pipeline.virtual_lab.machine.instruments.sampling import ANALOG_HZ
from pipeline.virtual_lab.machine.treadmill import Machine
from pipeline.virtual_lab.protocol.study_text import CUTOFF_HZ
from pipeline.virtual_lab.protocol.walking_protocol import (
    ANALYSED_CONDITIONS,
    ONSET_PHASE,
    PITCH_DEG,
    SWAY_M,
    sway_command,
)

TEMPLATE: Final = "table_3_page.md"
"""The page's text, beside this module; every number in braces is computed."""
MOVED: Final = removed(printed_cells())
"""Condition and axis of the residuals that the moving treadmill adds to."""
NOT_FITTED: Final = (AS_IS, DOCUMENTED)
SWAYED: Final = [axis for condition, axis in MOVED if condition == PERTURBED]
WINDOWS: Final = {"cycle": "the whole gait cycle", "motion": "the motion of the platform"}
"""Window in the table of residuals -> what it is called on the page."""
BANDWIDTHS_HZ: Final = (4.0, 7.0, 12.0, 20.0, 100.0)
"""Of the sway actuators, which the thesis does not state; the last one is all but ideal."""
ARRIVED: Final = 0.99
"""Share of its way after which the platform is taken to have arrived."""


def table_3_page(found: Reproduction) -> str:
    """Write the page.

    Parameters
    ----------
    found
        What `pipeline.virtual_lab.analysis.reproduction.reproduce` gave.

    Returns
    -------
    str
        Markdown; every number is computed from ``found`` or from the machine's data.
    """
    cells, protocol = compared(found), found.setting.protocol
    counts = cells[cells["headline"]]
    keyed = counts.set_index(["laboratory", "condition", "compensated", "axis"]).sort_index()
    mean, printed = keyed["mean"], keyed["mean_thesis"]
    moved = counts[~counts["compensated"] & _of_moving_treadmill(counts)]
    base, documented = (mean.loc[name, "baseline"] for name in (AS_IS, DOCUMENTED))
    change = (documented - base).abs().groupby("axis").max()
    sway, pitch = (mean.loc[AS_IS, name, False] for name in (PERTURBED, "pitch"))
    compensated_pitch = mean.loc[DOCUMENTED, "pitch", True]
    window = str(counts.loc[counts["condition"] == PERTURBED, "window"].iloc[0])
    weight_n, lifted_n = _pitched_weight()
    return (
        (files(__package__) / TEMPLATE)
        .read_text(encoding="utf-8")
        .format(
            subjects=protocol.subjects,
            baseline_s=protocol.baseline_s,
            perturbations=len(protocol.waits_s),
            pitch_s=protocol.pitch_s,
            headline=WINDOWS.get(window, window),
            table=_table(cells),
            within=_by_laboratory(counts),
            moved=_by_laboratory(moved),
            moved_cells=len(MOVED),
            window_s=found.unstated.value.window_s,
            motion_s=motion_s(),
            cycle_s=found.cycle_s,
            windows=_windows(_sway_windows(found, cells)),
            bandwidths=_bandwidths(found.cycle_s),
            met=_met(found.cycle_s),
            still_n=inertial_force(found.unstated.value.sway_hz, found.unstated.value.window_s),
            matches=_matches(_sway_windows(found, cells)),
            single=_single(found.single),
            weight_n=weight_n,
            lifted_n=lifted_n,
            pitch_fx=pitch["Fx"],
            pitch_fz=pitch["Fz"],
            pitch_arm=pitch["My"] / pitch["Fx"],
            thesis_kg=_mass() / 2 * printed.loc[AS_IS, "pitch", False, "Fx"] / weight_n,
            sway_height=sway["Mx"] / sway["Fy"],
            sway_ahead=sway["Mz"] / sway["Fy"],
            baseline_ratio=(printed.loc[AS_IS, "baseline"] / base).mean(),
            documented_n=change[_axes("N")].max(),
            documented_nm=change[_axes("N·m")].max(),
            pitch_fx_ic=compensated_pitch["Fx"],
            pitch_fy_ic=compensated_pitch["Fy"],
            **unstated_parts(found),
        )
    )


def motion_s() -> float:
    """Give how long the platform of the virtual laboratory moves in a sway perturbation [s].

    Examples
    --------
    >>> f"{motion_s():.2f}"
    '0.27'
    """
    time = np.arange(round(2 * ANALOG_HZ)) / ANALOG_HZ
    command = sway_command(np.zeros(1), np.ones(1), time)
    way = move_platform(Machine(), command, 0 * time, ANALOG_HZ).sway[0]
    return float(time[way >= ARRIVED * SWAY_M][0])


@cache
def inertial_force(bandwidth_hz: float, length_s: float, before_s: float = 0.0) -> float:
    """Give the force that moves both belt assemblies in a sway perturbation, RMS over a window [N].

    Parameters
    ----------
    bandwidth_hz
        Of the actuators.
    length_s
        Of the window [s].
    before_s
        How long before the onset the window starts [s].

    Returns
    -------
    float
        Of mass times acceleration, low-passed at 6 Hz as the residuals are.

    Examples
    --------
    >>> inertial_force(7.0, 0.3) > inertial_force(7.0, 0.7) > inertial_force(5.0, 0.7)
    True
    """
    machine, onset = replace(Machine(), sway_hz=bandwidth_hz), 1.0
    time = np.arange(round(4 * ANALOG_HZ)) / ANALOG_HZ
    command = sway_command(np.array([onset]), np.ones(1), time)
    acceleration = move_platform(machine, command, 0 * time, ANALOG_HZ).sway[2]
    force = _mass() * low_pass(acceleration, ANALOG_HZ, CUTOFF_HZ, "zero_phase")
    since = time - onset + before_s
    return float(np.sqrt(np.mean(force[(since >= 0) & (since < length_s)] ** 2)))


def _mass() -> float:
    """Give the mass of both belt assemblies [kg]."""
    return sum(assembly.mass for assembly in Machine().assemblies)


def _pitched_weight() -> tuple[float, float]:
    """Give the RMS of the assemblies' weight along and off the belts over a period of pitch [N]."""
    weight = GRAVITY_MPS2 * _mass()
    angle = np.radians(PITCH_DEG) * np.sin(np.linspace(0, 2 * np.pi, 1000, endpoint=False))
    along, off = (np.sqrt(np.mean(x**2)) for x in (np.sin(angle), 1 - np.cos(angle)))
    return float(weight * along), float(weight * off)


def _of_moving_treadmill(cells: pd.DataFrame) -> "pd.Series[bool]":
    """Give which cells the moving treadmill adds to without compensation."""
    found = pd.MultiIndex.from_frame(cells[["condition", "axis"]]).isin(MOVED)
    return pd.Series(found, index=cells.index)


def _by_laboratory(counts: pd.DataFrame) -> str:
    """Say how many cells of each laboratory are within the thesis' mean ± SD."""
    within = counts.groupby("laboratory")["within"].sum()
    return " and ".join(f"{within.loc[name]} {name}" for name in NOT_FITTED)


def _axes(unit: str) -> list[str]:
    return [axis for axis in AXES if UNIT_OF[axis] == unit]


def _texts(cells: pd.DataFrame, keys: Iterable[str]) -> "pd.Series[str]":
    """Write cells as mean ± SD, bold where within the thesis', by their keys."""
    texts = [
        f"**{mean:.1f} ± {sd:.1f}**" if within else f"{mean:.1f} ± {sd:.1f}"
        for mean, sd, within in zip(cells["mean"], cells["sd"], cells["within"], strict=True)
    ]
    return pd.Series(texts, index=pd.MultiIndex.from_frame(cells[[*keys]])).sort_index()


def _printed(cells: pd.DataFrame) -> pd.DataFrame:
    """Give the thesis' own cells, as `compared` gives others."""
    own = cells.assign(laboratory="thesis", mean=cells["mean_thesis"], sd=cells["sd_thesis"])
    return own.assign(within=False)


def _table(cells: pd.DataFrame) -> str:
    """Lay out all cells, a row per residual and condition, and one per window that is no headline.

    Cells to which values were fitted, and those that are judged further down, are not marked.
    """
    shown = pd.concat([_printed(cells[cells["laboratory"] == AS_IS]), cells])
    judged = shown["laboratory"].isin((DOCUMENTED, ESTIMATED)) & shown["compensated"]
    shown = shown.assign(within=shown["within"] & ~shown["fitted"] & ~judged)
    texts = _texts(shown, ("axis", "condition", "headline", "compensated", "laboratory"))
    columns = [(ic, name) for ic in (False, True) for name in ("thesis", *LABORATORIES)]
    heads = [f"{'IC' if ic else 'No IC'}: {name}" for ic, name in columns]
    heads[heads.index(f"No IC: {ESTIMATED}")] += ", fitted"
    rows = [["Residual", "Condition", *heads]]
    for axis in AXES:
        label = f"{axis} ({UNIT_OF[axis]})"
        for condition in ANALYSED_CONDITIONS:
            own = cells[(cells["condition"] == condition) & (cells["laboratory"] == AS_IS)]
            windows = own.drop_duplicates("headline").sort_values("headline", ascending=False)
            for window, headline in zip(windows["window"], windows["headline"], strict=True):
                name = condition if headline else f"{condition} ({window})"
                where = axis, condition, headline
                rows.append([label, name, *(str(texts.loc[(*where, *c)]) for c in columns)])
                label = ""
    return markdown(rows)


def _sway_windows(found: Reproduction, cells: pd.DataFrame) -> pd.DataFrame:
    """Give the sway cells as it is without compensation, also over windows from the onset on."""
    after = found.windows[~found.windows["compensated"] & (found.windows["laboratory"] == AS_IS)]
    table = after.groupby(["length_s", "axis"])["rms"].agg(["mean", "std"]).reset_index()
    table = table.rename(columns={"std": "sd"})
    table["window"] = table["length_s"].map("{:g} s".format)
    own = cells[(cells["condition"] == PERTURBED) & ~cells["compensated"]]
    own = own[own["laboratory"] == AS_IS]
    thesis = own.drop_duplicates("axis")[["axis", "mean_thesis", "sd_thesis"]]
    table = pd.concat([table, own[["window", "axis", "mean", "sd"]]]).merge(thesis, on="axis")
    off = (table["mean"] - table["mean_thesis"]).abs()
    table = table.assign(within=off <= table["sd_thesis"])
    return table[table["axis"].isin(SWAYED)]


def _windows(table: pd.DataFrame) -> str:
    windows = [str(window) for window in table["window"].unique()]
    printed = _printed(table[table["window"] == windows[0]]).assign(window="thesis")
    texts = _texts(pd.concat([table, printed]), ("window", "axis"))
    rows = [["Window", *(f"{axis} ({UNIT_OF[axis]})" for axis in SWAYED)]]
    for window in (*windows, "thesis"):
        rows.append([window, *(str(texts.loc[window, axis]) for axis in SWAYED)])
    return markdown(rows)


def _matches(table: pd.DataFrame) -> str:
    """Say which windows give the thesis' numbers, and whether one gives all of them."""
    fitting = {
        axis: [str(w) for w in table.loc[(table["axis"] == axis) & table["within"], "window"]]
        for axis in SWAYED
    }
    each = "; ".join(f"{axis}: {', '.join(own) or 'none'}" for axis, own in fitting.items())
    common = sorted(set.intersection(*map(set, fitting.values())))
    return f"{each}; all three: {', '.join(common) or 'none'}"


def _bandwidths(cycle_s: float) -> str:
    """Lay out the force that moves the assemblies by window and bandwidth of the actuators."""
    windows = {f"{length_s:g} s": (length_s, 0.0) for length_s in LENGTHS_S}
    windows["cycle"] = cycle_s, ONSET_PHASE * cycle_s
    rows = [["Window", *(f"{hz:g} Hz" for hz in BANDWIDTHS_HZ)]]
    for name, window in windows.items():
        rows.append([name, *(f"{inertial_force(hz, *window):.0f}" for hz in BANDWIDTHS_HZ)])
    return markdown(rows)


def _met(cycle_s: float) -> str:
    """Say between which windows the force is the thesis' Fy, by bandwidth."""
    own = printed_cells().set_index(["axis", "condition", "compensated"])["mean"]
    wanted = own.loc["Fy", PERTURBED, False]
    texts = []
    for hz in BANDWIDTHS_HZ:
        above = [s for s in LENGTHS_S if inertial_force(hz, s) > wanted]
        after = [f"{s:g}" for s in LENGTHS_S if s > above[-1]] if above else []
        if after:
            texts.append(f"{hz:g} Hz: {above[-1]:g} to {after[0]} s")
    return "; ".join(texts)


def _single(single: pd.DataFrame) -> str:
    """Lay out the largest changes that single items make."""
    cells = single.pivot(index=["compensated", "condition", "axis"], columns="item", values="rms")
    columns = [(ic, name) for ic in (False, True) for name in ANALYSED_CONDITIONS]
    rows = [["Item", *(f"{name}, {'IC' if ic else 'no IC'}" for ic, name in columns)]]
    for item in ITEMS:
        change = cells[item] - cells["none"]
        rows.append([item, *(_largest(change.loc[column]) for column in columns)])
    return markdown(rows)


def _largest(change: "pd.Series[float]") -> str:
    """Give the largest change of a force and of a moment that is not zero to one decimal."""
    parts = []
    for unit in dict.fromkeys(UNITS):
        own = change[_axes(unit)].round(1)
        axis = str(own.abs().idxmax())
        if own[axis] != 0:
            parts.append(f"{axis} {own[axis]:+.1f}")
    return ", ".join(parts) or "0"
