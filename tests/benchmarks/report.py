"""Tables of the measurements, and targets."""

import os
import platform
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from rich.console import Console
from rich.table import Table

from tests.benchmarks.comparison import COMPILED, KERNELS, MACHINE

PACKAGES = ("hbm-residuals", "casadi", "numpy", "scipy", "opensim", "mujoco", "pin")
COLUMNS = {
    "ik": {
        "frames/s": ("frames_per_s", ",.0f"),
        "wall µs": ("wall_us", ",.1f"),
        "CPU µs": ("cpu_us", ",.1f"),
        "user µs": ("user_us", ",.1f"),
        "CPU × ours": ("cpu_ratio", ",.1f"),
        "wall × ours": ("wall_ratio", ",.1f"),
        "RMS mm": ("marker_rms_m", ".6f", 1e3),
        "error, max rad": ("angle_max_rad", ".1e"),
        "RMS rad": ("angle_rms_rad", ".1e"),
        "max m": ("translation_max_m", ".1e"),
    },
    "scaling": {
        "IK frames/s": ("ik_frames_per_s", ",.0f"),
        "IK CPU µs": ("ik_cpu_us", ".1f"),
        "× first": ("ik_cpu_ratio", ".2f"),
    },
}
COLUMNS["id"] = dict(list(COLUMNS["ik"].items())[:6]) | {
    "force error N, N·m": ("force_error", ".1e")
}
COLUMNS["frames"] = COLUMNS["scaling"] | {
    "ID frames/s": ("id_frames_per_s", ",.0f"),
    "ID CPU µs": ("id_cpu_us", ".1f"),
    "ID × first": ("id_cpu_ratio", ".2f"),
}
COLUMNS["coordinates"] = {
    "markers": ("markers", "d"),
    "coordinates": ("coordinates", "d"),
} | COLUMNS["scaling"]
COLUMNS["gaps"] = COLUMNS["scaling"] | {
    "solved": ("solved", "d"),
    "marked": ("marked", "d"),
    "of frames": ("frames", "d"),
    "in another minimum": ("elsewhere", "d"),
}
COLUMNS["events"] = {
    "event": ("event", ""),
    "condition": ("condition", ""),
    "mean ms": ("mean_ms", "+.1f"),
    "SD ms": ("sd_ms", ".1f"),
    "found": ("found", "d"),
    "missed": ("missed", "d"),
    "invented": ("invented", "d"),
}
COLUMNS["live"] = {
    "median µs": ("median_us", ",.0f"),
    "99 % µs": ("p99_us", ",.0f"),
    "99.9 % µs": ("p999_us", ",.0f"),
    "largest µs": ("largest_us", ",.0f"),
    "CPU µs, all of a frame": ("cpu_us", ",.0f"),
    "share of a core": ("core", ".2f"),
}
COLUMNS["treadmill events"] = {
    "event": ("event", ""),
    "mean ms": ("mean_ms", "+.1f"),
    "SD ms": ("sd_ms", ".1f"),
    "matched": ("matched", "d"),
    "only first": ("only_first", "d"),
    "only second": ("only_second", "d"),
}
EVENT_LIMITS_MS = {"baseline": (5, 10), "sway": (5, 10), "pitch": (10, 15)}
"""Condition -> limits of the mean error and of its standard deviation."""
TITLES = {
    "events": "Gait events against the truth of the virtual laboratory",
    "treadmill events": "Gait events of a treadmill recording by one method against another",
    "ik": "Inverse kinematics, per frame",
    "id": "Inverse dynamics with residuals, per frame",
    "frames": "Ours by length of the trial",
    "coordinates": "Ours by markers and the coordinates they observe",
    "gaps": "Ours with missing markers",
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
            opensim, kernels = forces["OpenSim"][key], forces[KERNELS][key]
            at_least(f"ID with Pinocchio × OpenSim ({clock})", opensim, 30)
            at_least(f"ID with kernels × OpenSim ({clock})", opensim / kernels, 60)
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
    for row in measured.get("gaps", [])[1:]:
        at_most(f"time with {row['name']}, × complete", row["ik_cpu_ratio"], 1.2)
        at_most(f"frames lost with {row['name']}", row["frames"] - row["solved"] - row["marked"], 0)
    for row in measured.get("events", []):
        if row["name"] == "hbm, auto":
            name, (mean_ms, sd_ms) = row["condition"], EVENT_LIMITS_MS[row["condition"]]
            at_most(f"{row['event']}, {name}: mean error [ms]", abs(row["mean_ms"]), mean_ms)
            at_most(f"{row['event']}, {name}: SD [ms]", row["sd_ms"], sd_ms)
            at_most(f"{row['event']}, {name}: missed", row["missed"], 0)
            at_most(f"{row['event']}, {name}: invented", row["invented"], 0)
    for row in measured.get("live", []):
        if row["name"].startswith("100 Hz"):
            at_most(f"live, {row['name']}: median [µs]", row["median_us"], 500)
            at_most(f"live, {row['name']}: 99.9 % [µs]", row["p999_us"], 2000)
        at_most(f"live, {row['name']}: share of a core", row["core"], 1)
    if "live_loopback" in measured:
        loopback = measured["live_loopback"]
        at_most("live, from sending to receiving, 99 % [ms]", loopback["p99_ms"], 5)
        at_most("live, first frame after the start [s]", loopback["first_frame_s"], 3)
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
    console = Console(highlight=False, markup=False, width=max(150, Console().width))
    console.print(
        ", ".join(f"{name} {x}" for name, x in measured["machine"]["versions"].items() if x)
    )
    for part, title in TITLES.items():
        if part in measured:
            console.print(_table(title, measured[part], COLUMNS[part]))
    if "commands" in measured:
        commands = measured["commands"]
        console.print(
            f"hbm --help {commands['help_s']:.2f} s; hbm residuals on {commands['frames']} frames: "
            f"{commands['residuals_s']:.1f} s"
        )
    if "live_offline_us" in measured:
        console.print(
            f"the same trial from a file, process_recording: {measured['live_offline_us']:.0f} µs "
            "of the processor a frame"
        )
    if "live_loopback" in measured:
        loopback = measured["live_loopback"]
        console.print(
            f"by LSL between three processes, {loopback['frames_received']} frames from sending to "
            f"receiving: median {loopback['median_ms']:.2f} ms, 99 % {loopback['p99_ms']:.2f}, "
            f"99.9 % {loopback['p999_ms']:.2f}, largest {loopback['largest_ms']:.2f}; first frame "
            f"{loopback['first_frame_s']:.2f} s after the start"
        )
    if "memory" in measured:
        memory = measured["memory"]
        console.print(
            f"{memory['frames']} frames, 46 markers, 30 channels at 1000 Hz, file to residuals: "
            f"{memory['peak_bytes'] / 1e9:.2f} GB at most, {memory['seconds']:.1f} s, "
            f"{memory['solved']} frames with residuals"
        )
    for target in targets:
        bound = "at least" if target.at_least else "at most"
        console.print(
            f"{'met   ' if target.met else 'MISSED'} {target.name}: {target.value:.3g}, "
            f"{bound} {target.limit:g}"
        )


def _table(title: str, rows: list[dict[str, Any]], columns: dict[str, tuple]) -> Table:
    lengths = {row["frames"] for row in rows if "frames" in row}
    if len(lengths) == 1:
        title += f", {lengths.pop():,} frames"
    table = Table(title=title, title_justify="left")
    table.add_column("", no_wrap=True)
    for name in columns:
        table.add_column(name, justify="right")
    for row in rows:
        cells = [
            format(row[key] * (scale[0] if scale else 1), style)
            for key, style, *scale in columns.values()
        ]
        table.add_row(row["name"], *cells)
    return table
