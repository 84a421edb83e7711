"""Tables of the measurements, and targets."""

import os
import platform
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import pandas as pd

from tests.benchmarks.comparison import COMPILED, MACHINE

PACKAGES = ("hbm-residuals", "casadi", "numpy", "scipy", "opensim", "mujoco", "pin")
EVENT_LIMITS_MS = {"baseline": (5, 10), "sway": (5, 10), "pitch": (10, 15)}
"""Condition -> limits of the mean error and of its standard deviation."""
START_RATIOS = {
    "hbm --help": 0.5,
    "hbm --version": 0.5,
    "hbm FOLDER": 1,
    "hbm residuals, table": 3,
    "hbm residuals": 6,
}
"""Command -> most processor time, as a multiple of loading NumPy and pandas."""
TITLES = {
    "events": "Gait events against the truth of the virtual laboratory",
    "ik": "Inverse kinematics, per frame",
    "id": "Inverse dynamics with residuals, per frame",
    "study": "A study: a subject and 408 frames per trial",
    "start": "Commands from their start, processor time",
    "live": "Live frames, from their last sample to the result, on the clock",
}


@dataclass(frozen=True)
class Target:
    """A target: ``value`` must be at least, or at most, ``limit``."""

    name: str
    value: float
    limit: float
    at_least: bool

    @property
    def met(self) -> bool:
        return self.value >= self.limit if self.at_least else self.value <= self.limit


def targets(measured: dict[str, Any]) -> list[Target]:
    """Compare the measurements with their targets; parts that were not run are left out."""
    ik = {row["key"]: row for row in measured.get("ik", [])}
    forces = {row["key"]: row for row in measured.get("id", [])}
    out = []

    def at_least(name: str, value: float, limit: float) -> None:
        out.append(Target(name, value, limit, at_least=True))

    def at_most(name: str, value: float, limit: float) -> None:
        out.append(Target(name, value, limit, at_least=False))

    for clock in ("cpu", "wall"):
        key = f"{clock}_ratio"
        if "OpenSim" in ik:
            at_least(f"IK × OpenSim ({clock})", ik["OpenSim"][key], 300)
            relative = ik["OpenSim"][key] / ik[MACHINE][key]
            at_least(f"IK without compiler × OpenSim ({clock})", relative, 10)
        if "MuJoCo" in ik:
            at_least(f"IK × MuJoCo ({clock})", ik["MuJoCo"][key], 15)
        if "OpenSim" in forces:
            at_least(f"ID × OpenSim ({clock})", forces["OpenSim"][key], 60)
    if ik:
        ours, optimum = ik[COMPILED], measured["optimum"]
        best = min(row["marker_rms_m"] for row in ik.values())
        at_most("marker RMS above the best of all [m]", ours["marker_rms_m"] - best, 1e-6)
        at_most("angle error against the optimum [rad]", ours["angle_max_rad"], 1e-5)
        at_most(
            "difference of compiled and virtual machine [rad or m]",
            measured["backends_differ"],
            1e-9,
        )
        at_most(
            "difference of our optimum and SciPy's [rad or m]",
            measured["optimum"]["scipy_distance"],
            1e-6,
        )
        at_most("next step at the optimum [rad or m]", optimum["gauss_newton_step"], 1e-9)
    for row in measured.get("events", []):
        if row["name"] == "hbm, auto":
            name, (mean_ms, sd_ms) = row["condition"], EVENT_LIMITS_MS[row["condition"]]
            at_most(f"{row['event']}, {name}: mean error [ms]", abs(row["mean_ms"]), mean_ms)
            at_most(f"{row['event']}, {name}: SD [ms]", row["sd_ms"], sd_ms)
            at_most(f"{row['event']}, {name}: missed", row["missed"], 0)
            at_most(f"{row['event']}, {name}: invented", row["invented"], 0)
    for row in measured.get("live", []):
        if row["name"].startswith("100 Hz"):
            most_us = 500 if row["name"].endswith("markers last") else 400
            at_most(f"live, {row['name']}: median [µs]", row["median_us"], most_us)
            at_most(f"live, {row['name']}: 99.9 % [µs]", row["p999_us"], 2000)
        at_most(f"live, {row['name']}: share of a core", row["core"], 1)
    if "live_loopback" in measured:
        loopback = measured["live_loopback"]
        at_most("live, from sending to receiving, 99 % [ms]", loopback["p99_ms"], 5)
        at_most("live, first frame after the start [s]", loopback["first_frame_s"], 3)
    for row in measured.get("start", []):
        if row["name"] in START_RATIOS:
            most = START_RATIOS[row["name"]]
            at_most(f"{row['name']}: processor time × NumPy and pandas", row["cpu_ratio"], most)
    if "commands" in measured:
        at_most("hbm residuals [s]", measured["commands"]["residuals_s"], 30)
    if "memory" in measured:
        at_most("peak memory of a long trial [GB]", measured["memory"]["peak_bytes"] / 1e9, 1.5)
    return out


def machine() -> dict[str, Any]:
    """Describe the machine and the versions of the programs."""
    versions = {}
    for name in PACKAGES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = None
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    return {
        "system": platform.platform(),
        "python": platform.python_version(),
        "cores": os.cpu_count(),
        "load_before": load,
        "versions": versions,
    }


def show(measured: dict[str, Any], targets: list[Target]) -> None:
    """Print a table for each part with rows, the other parts' numbers, and the targets."""
    print(", ".join(f"{name} {x}" for name, x in measured["machine"]["versions"].items() if x))
    for part, found in measured.items():
        if part in TITLES:
            print(f"\n{TITLES[part]}\n")
            table = pd.DataFrame(found).drop(columns="key", errors="ignore")
            print(table.to_string(index=False, float_format="{:,.4g}".format))
        elif part not in ("machine", "targets"):
            numbers = found.items() if isinstance(found, dict) else [(part, found)]
            print(f"\n{part}: " + ", ".join(f"{name} {x:.4g}" for name, x in numbers))
    for target in targets:
        bound = "at least" if target.at_least else "at most"
        print(
            f"{'met   ' if target.met else 'MISSED'} {target.name}: {target.value:.3g}, "
            f"{bound} {target.limit:g}"
        )
