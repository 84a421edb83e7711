"""The demonstration: a simulated trial, written as a C3D file and processed as any file is."""

from pathlib import Path

from rich.console import Console

from pipeline.one_trial import Request, run
from pipeline.virtual_lab.trial import simulate_trial

MARKER_NOISE_M = 0.0005
PLATE_NOISE_N = 0.5


def demo(out: Path) -> None:
    """Simulate a walking trial and process it.

    Parameters
    ----------
    out
        Folder for the trial and the results.
    """
    console = Console(highlight=False, markup=False)
    out.mkdir(parents=True, exist_ok=True)
    trial = out / "virtual_walker.c3d"
    console.print(f"simulating a walking person into {trial}", soft_wrap=True)
    simulate_trial(trial, marker_noise_m=MARKER_NOISE_M, plate_noise_n=PLATE_NOISE_N)
    run(Request(trial=trial, sex="male"), out)
    console.print(
        f"The simulated recording has {MARKER_NOISE_M * 1000:g} mm of marker noise and "
        f"{PLATE_NOISE_N:g} N of plate noise; the residuals above are what the noise, and a body "
        "estimated from noisy markers, leave."
    )
