"""How this machine runs kernels, and which engine of the inverse dynamics."""

import platform
import timeit
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Final

from pipeline.cli.terminal import PlainConsole, announcer

if TYPE_CHECKING:
    from hbm.kernels.kernel import Kernel

FRAMES: Final = 4096
"""How many frames a kernel is timed with: milliseconds, so that a clock resolves it."""


def doctor() -> None:
    """Kernels are timed; the engine of the inverse dynamics is named."""
    from hbm.dynamics import engine_name
    from hbm.kernels.native import kernels

    console = PlainConsole()
    console.say(f"Python {platform.python_version()} on {platform.platform()}")
    packages = ("hbm-residuals", "pin", "casadi", "numpy", "scipy")
    for name in (*packages, "pandas", "rerun-sdk", "pingouin", "ezc3d"):
        try:
            console.print(f"  {name} {version(name)}")
        except PackageNotFoundError:
            console.print(f"  {name} is missing")
    ready = kernels(announcer(console))
    console.say(f"kernels: {ready.backend}")
    for name in ("newton_step", "segment_poses", "newton_euler"):
        rate = speed(getattr(ready, name))
        console.print(f"  {name}: {rate:,.0f} frames/s on one core ({1e6 / rate:.1f} µs)")
    console.say(f"inverse dynamics: {engine_name()}")


def speed(kernel: "Kernel") -> float:
    """Measure a kernel [frames/s], the best of some repetitions."""
    import numpy as np

    random = np.random.default_rng(0)
    inputs = [
        random.normal(size=n if i in kernel.constant_inputs else (FRAMES, n))
        for i, n in enumerate(kernel.sizes_in)
    ]
    return FRAMES / min(timeit.repeat(lambda: kernel(*inputs), number=1, repeat=4))
