"""How this machine runs kernels and engines."""

import platform
import time
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hbm.engines.engine import EngineName
    from hbm.kernels.kernel import Kernel
    from hbm.motion import Motion

PACKAGES = (
    "hbm-residuals",
    "pin",
    "casadi",
    "numpy",
    "scipy",
    "pandas",
    "rerun-sdk",
    "pingouin",
    "ezc3d",
)
FRAMES = 4096
"""How many frames a kernel is timed with: milliseconds, so that a clock resolves it."""
REPETITIONS = 3


def doctor() -> None:
    """Print versions, how kernels and engines run here, how fast, and whether the engines agree."""
    from hbm.engines.engine import ENGINES, choose_engine
    from hbm.kernels.native import kernels
    from pipeline.cli.terminal import PlainConsole, announcer

    console = PlainConsole()
    console.say(f"Python {platform.python_version()} on {platform.platform()}")
    for name in PACKAGES:
        try:
            console.print(f"  {name} {version(name)}")
        except PackageNotFoundError:
            console.print(f"  {name} is missing")
    ready = kernels(announcer(console))
    console.say(f"kernels: {ready.backend}")
    for name in ("newton_step", "segment_poses", "newton_euler"):
        rate = speed(getattr(ready, name))
        console.print(f"  {name}: {rate:,.0f} frames/s on one core ({1e6 / rate:.1f} µs)")
    console.print(f"inverse dynamics: {choose_engine().name} unless another engine is stated")
    for engine in ENGINES:
        console.say(f"  {engine}: {engine_report(engine)}")


def engine_report(engine: "EngineName") -> str:
    """Say how fast an engine runs and how well the other one agrees, or why it does not run."""
    import numpy as np

    from hbm.body import build_body
    from hbm.dynamics import inverse_dynamics
    from hbm.markers import Markers
    from pipeline.virtual_lab.person.subject import Person, make_subject, t_pose_markers

    subject = make_subject(Person())
    standing = t_pose_markers(subject)[None].repeat(3, axis=0)
    markers = Markers(np.arange(3.0), subject.skeleton.markers, standing)
    body = build_body(markers, mass=subject.person.mass_kg, sex=subject.person.sex)
    motion = random_motion()
    feet = dict.fromkeys(("left_foot", "right_foot"), np.ones((FRAMES, 6)))
    seconds = []
    try:
        for _ in range(REPETITIONS + 1):
            start = time.perf_counter()
            used = inverse_dynamics(body, motion, feet, engine=engine).engine
            seconds.append(time.perf_counter() - start)
    except ValueError as error:
        return str(error)
    rate = FRAMES / min(seconds)
    return f"{rate:,.0f} frames/s on one core ({1e6 / rate:.1f} µs); {used.note}"


def random_motion() -> "Motion":
    """Give a motion in which every coordinate moves."""
    import numpy as np

    from hbm.coordinates import N_Q
    from hbm.motion import Motion

    q, v, a = np.random.default_rng(0).normal(size=(3, FRAMES, N_Q))
    return Motion(
        time=np.arange(FRAMES) / 100.0,
        q=q,
        v=v,
        a=a,
        markers=(),
        marker_error=np.zeros((FRAMES, 0)),
        converged=np.ones(FRAMES, bool),
        observed=np.ones((FRAMES, N_Q), bool),
    )


def speed(kernel: "Kernel") -> float:
    """Measure a kernel [frames/s], the best of some repetitions."""
    import numpy as np

    random = np.random.default_rng(0)
    inputs = [
        random.normal(size=n if i in kernel.constant_inputs else (FRAMES, n))
        for i, n in enumerate(kernel.sizes_in)
    ]
    kernel(*inputs)
    seconds = []
    for _ in range(REPETITIONS):
        start = time.perf_counter()
        kernel(*inputs)
        seconds.append(time.perf_counter() - start)
    return FRAMES / min(seconds)
