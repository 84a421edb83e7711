"""All implementations on the same trial: inverse kinematics, then inverse dynamics."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from importlib.util import find_spec

from tests.benchmarks.accuracy import force_error, kinematic_error
from tests.benchmarks.implementation import Implementation, Timing, ratio, time_alternately
from tests.benchmarks.trial import Trial

COMPILED, MACHINE = "hbm, compiled", "hbm, virtual machine"
OTHERS = ("OpenSim", "MuJoCo", "Pinocchio")
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
ID_RESULT = {"OpenSim": "id"}
"""Task that gives the forces, where it is another than the one that is timed."""
Row = dict[str, float | str]


@contextmanager
def implementations(trial: Trial) -> Iterator[dict[str, Implementation]]:
    """Start ours, compiled and not, and every other that is installed."""
    with ExitStack() as stack:
        machine = {"HBM_KERNELS": "virtual-machine"}
        yield {
            COMPILED: stack.enter_context(Implementation("ours", trial.folder)),
            MACHINE: stack.enter_context(Implementation("ours", trial.folder, **machine)),
        } | {
            name: stack.enter_context(Implementation(f"{name.lower()}_peer", trial.folder))
            for name in OTHERS
            if find_spec(name.lower())
        }


def compare_kinematics(trial: Trial, running: dict[str, Implementation], repeats: int) -> list[Row]:
    """Time the inverse kinematics; the time that OpenSim spends on files is subtracted."""
    timings = {name: Timing(name, running[name], "ik") for name in (COMPILED, MACHINE)} | _timings(
        IK, running
    )
    errors = {name: asdict(kinematic_error(trial, running[name].result("ik"))) for name in timings}
    time_alternately(list(timings.values()), repeats)
    return [_row(timings, name, trial) | errors[name] for name in timings]


def compare_dynamics(trial: Trial, running: dict[str, Implementation], repeats: int) -> list[Row]:
    """Time the inverse dynamics; ours computes two variants of the plates, the others one.

    OpenSim differentiates the coordinates itself, and so does ours unless their rates are given.
    """
    compiled, machine = running[COMPILED], running[MACHINE]
    timings = {
        COMPILED: Timing(f"{COMPILED}, with filter, two variants", compiled, "id"),
        MACHINE: Timing(f"{MACHINE}, with filter, two variants", machine, "id"),
        f"{COMPILED}, rates": Timing(
            f"{COMPILED}, rates given, two variants", compiled, "id from rates"
        ),
    } | _timings(ID, running)
    errors = {
        name: force_error(trial, timing.implementation.result(ID_RESULT.get(name, timing.task)))
        for name, timing in timings.items()
    }
    time_alternately(list(timings.values()), repeats)
    return [_row(timings, name, trial) | {"force_error": errors[name]} for name in timings]


def _timings(tasks, running: dict[str, Implementation]) -> dict[str, Timing]:
    return {
        name: Timing(title, running[name], task, overhead)
        for name, (title, task, overhead) in tasks.items()
        if name in running
    }


def _row(timings: dict[str, Timing], name: str, trial: Trial) -> Row:
    frames, timing, ours = len(trial.markers.time), timings[name], timings[COMPILED]
    return {
        "key": name,
        "name": timing.name,
        "frames": frames,
        "frames_per_s": frames / timing.median("wall"),
        **{f"{clock}_us": 1e6 * timing.median(clock) / frames for clock in ("wall", "cpu", "user")},
        "cpu_ratio": ratio(timing, ours, "cpu"),
        "wall_ratio": ratio(timing, ours, "wall"),
    }
