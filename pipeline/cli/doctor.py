"""How this machine runs the kernels."""

import platform
import time
from importlib.metadata import PackageNotFoundError, version

import numpy as np
from rich.console import Console

from hbm.kernels.native import Kernel, cache_directory, kernels

PACKAGES = ("hbm-residuals", "pin", "casadi", "numpy", "scipy", "pandas", "rerun-sdk", "pingouin")
FRAMES = 4096


def run() -> None:
    """Print versions, the kernels' backend and their speed on one core."""
    console = Console(highlight=False, markup=False)
    console.print(f"Python {platform.python_version()} on {platform.platform()}", soft_wrap=True)
    for name in PACKAGES:
        try:
            console.print(f"  {name} {version(name)}")
        except PackageNotFoundError:
            console.print(f"  {name} is missing")
    ready = kernels(lambda sentence: console.print(sentence, style="dim"))
    console.print(f"kernels: {ready.backend}; cache {cache_directory()}", soft_wrap=True)
    for name in ("newton_step", "segment_poses", "newton_euler"):
        rate = speed(getattr(ready, name))
        console.print(f"  {name}: {rate:,.0f} frames/s on one core ({1e6 / rate:.1f} µs)")


def speed(kernel: Kernel) -> float:
    """Measure a kernel [frames/s], best of three runs over 4096 frames."""
    random = np.random.default_rng(0)
    inputs = [
        random.normal(size=n if i in kernel.constant_inputs else (FRAMES, n))
        for i, n in enumerate(kernel.sizes_in)
    ]
    kernel(*inputs)
    taken = []
    for _ in range(3):
        start = time.perf_counter()
        kernel(*inputs)
        taken.append(time.perf_counter() - start)
    return FRAMES / min(taken)
