"""Everyone on the same trial, taking turns: inverse kinematics, then inverse dynamics."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from importlib.util import find_spec

from tests.benchmarks.accuracy import force_error, kinematic_error
from tests.benchmarks.contestant import Contestant, Entry, race, ratio
from tests.benchmarks.trial import Trial

COMPILED, MACHINE = "hbm, compiled", "hbm, virtual machine"
PEERS = ("OpenSim", "MuJoCo", "Pinocchio")
IK = {
    "OpenSim": ("OpenSim IK tool", "ik tool", "ik files"),
    "MuJoCo": ("MuJoCo, Gauss–Newton", "ik", None),
    "Pinocchio": ("Pinocchio, Gauss–Newton", "ik", None),
}
ID = {
    "OpenSim": ("OpenSim ID tool", "id tool", "id files"),
    "MuJoCo": ("MuJoCo mj_inverse, rates given", "id", None),
    "Pinocchio": ("Pinocchio rnea, rates given", "id", None),
}
Row = dict[str, float | str]


@contextmanager
def contestants(trial: Trial) -> Iterator[dict[str, Contestant]]:
    """Start ourselves, compiled and not, and every peer that is installed."""
    with ExitStack() as stack:
        machine = {"HBM_KERNELS": "virtual-machine"}
        yield {
            COMPILED: stack.enter_context(Contestant("ours", trial.folder)),
            MACHINE: stack.enter_context(Contestant("ours", trial.folder, **machine)),
        } | {
            name: stack.enter_context(Contestant(f"{name.lower()}_peer", trial.folder))
            for name in PEERS
            if find_spec(name.lower())
        }


def kinematics_race(trial: Trial, running: dict[str, Contestant], laps: int) -> list[Row]:
    """Race the inverse kinematics; what OpenSim spends on files is taken off."""
    entries = {name: Entry(name, running[name], "ik") for name in (COMPILED, MACHINE)} | _peers(
        IK, running
    )
    errors = {name: asdict(kinematic_error(trial, running[name].answer("ik"))) for name in entries}
    race(list(entries.values()), laps)
    return [_row(entries, name, trial) | errors[name] for name in entries]


def dynamics_race(trial: Trial, running: dict[str, Contestant], laps: int) -> list[Row]:
    """Race the inverse dynamics; ours does two variants of the plates, the others one.

    OpenSim differentiates by itself, and so do we unless the rates are given.
    """
    peers = _peers(ID, running)
    entries = {
        COMPILED: Entry(f"{COMPILED}, with filter, two variants", running[COMPILED], "id"),
        MACHINE: Entry(f"{MACHINE}, with filter, two variants", running[MACHINE], "id"),
        "rates": Entry(
            f"{COMPILED}, rates given, two variants", running[COMPILED], "id from rates"
        ),
    } | peers
    errors = {
        name: force_error(trial, running.get(name, running[COMPILED]).answer("id"))
        for name in entries
    }
    race(list(entries.values()), laps)
    return [_row(entries, name, trial) | {"force_error": errors[name]} for name in entries]


def _peers(what, running: dict[str, Contestant]) -> dict[str, Entry]:
    return {
        name: Entry(title, running[name], task, less)
        for name, (title, task, less) in what.items()
        if name in running
    }


def _row(entries: dict[str, Entry], name: str, trial: Trial) -> Row:
    frames, entry, ours = len(trial.markers.time), entries[name], entries[COMPILED]
    return {
        "key": name,
        "name": entry.name,
        "frames": frames,
        "frames_per_s": frames / entry.median("wall"),
        **{f"{clock}_us": 1e6 * entry.median(clock) / frames for clock in ("wall", "cpu", "user")},
        "cpu_ratio": ratio(entry, ours, "cpu"),
        "wall_ratio": ratio(entry, ours, "wall"),
    }
