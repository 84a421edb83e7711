"""How this machine runs the kernels."""

import platform
import time
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hbm.kernels.native import Kernel

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
    "c3d",
)
FRAMES = 4096
"""How many frames a kernel is timed with: milliseconds, so that a clock resolves it."""
REPETITIONS = 3


def doctor() -> None:
    """Print versions, how the kernels run here, and how fast."""
    from hbm.kernels import native
    from pipeline.cli.terminal import announcer, plain_console

    console = plain_console()
    console.print(f"Python {platform.python_version()} on {platform.platform()}", soft_wrap=True)
    for name in PACKAGES:
        try:
            console.print(f"  {name} {version(name)}")
        except PackageNotFoundError:
            console.print(f"  {name} is missing")
    kernels = native.kernels(announcer(console))
    console.print(f"kernels: {kernels.backend}; cache {native.cache_directory()}", soft_wrap=True)
    for name in ("newton_step", "segment_poses", "newton_euler"):
        rate = speed(getattr(kernels, name))
        console.print(f"  {name}: {rate:,.0f} frames/s on one core ({1e6 / rate:.1f} µs)")


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
