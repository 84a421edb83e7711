"""Make ``healthy.csv``: bands of healthy adults behind joint angles and moments.

Run as ``python -m tests.virtual_gait.fit_healthy NORMS.csv`` with the norms of Pinzone et al.
(2014) as published (see `fit_gait`).
"""

import argparse
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from hbm.spatial import Array
from tests.virtual_gait.fit_gait import HARMONICS, fourier

HEALTHY_CSV: Final = Path(__file__).parents[2] / "pipeline" / "figures" / "healthy.csv"
HEADER: Final = """\
# Healthy adults walking, of two centres: Fourier coefficients of mean and SD over the gait cycle
# from initial contact [deg, N·m/kg]. The mean is that of both centres, the SD is pooled with half
# of the difference between them. Made by tests/virtual_gait/fit_healthy.py from: Pinzone O,
# Schwartz MH, Thomason P, Baker R (2014) The comparison of normative reference data from different
# gait analysis services, Gait Posture 40:286-290. Signs are those of pipeline/trial/joints.py.
# Without rotations, pronation and the ankle's angle, whose zeros differ between models, and without
# the hip's abduction moment: in one real recording, Plug-in Gait has two thirds of ours.
"""
NORM: Final = {
    ("hip_flexion", "angle"): ("Hip Flx/Ext", 1),
    ("hip_abduction", "angle"): ("Hip Add/Abd", -1),
    ("knee_flexion", "angle"): ("Knee Flx/Ext", 1),
    ("hip_flexion", "moment"): ("Hip Extensor Moment", -1),
    ("knee_flexion", "moment"): ("Knee Extensor Moment", -1),
    ("ankle_plantarflexion", "moment"): ("Plantarflexor Moment", 1),
}
"""Motion and curve -> name in the norms, and sign relative to them."""


def read_bands(path: Path) -> dict[tuple[str, str], tuple[Array, Array]]:
    """Read mean and SD of the motions and curves in `NORM`, at 50 phases, (50,) each."""
    table = pd.read_csv(path)
    table = table[table["percent"] < 100]
    bands = {}
    for key, (name, sign) in NORM.items():
        of_name = table[(table["name"] == name) & (table["quantity"] == key[1])]
        means = sign * of_name[["centre_one_mean", "centre_two_mean"]].to_numpy()
        spreads = of_name[["centre_one_sd", "centre_two_sd"]].to_numpy()
        # variance within centres, and between them
        variance = np.mean(spreads**2, axis=1) + np.var(means, axis=1)
        bands[key] = means.mean(axis=1), np.sqrt(variance)
    return bands


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m tests.virtual_gait.fit_healthy", description=__doc__
    )
    parser.add_argument("norms", type=Path, help="CSV file of the norms as published")
    norms = parser.parse_args().norms
    harmonics = range(HARMONICS + 1)
    heads = [f"{wave}_{k}" for k in harmonics for wave in ("cosine", "sine")]
    rows = [",".join(["motion", "curve", "statistic", *heads])]
    for key, band in read_bands(norms).items():
        for statistic, values in zip(("mean", "sd"), band, strict=True):
            numbers = [f"{number + 0.0:.4f}" for number in fourier(values).round(4).ravel()]
            rows.append(",".join([*key, statistic, *numbers]))
    HEALTHY_CSV.write_text(HEADER + "\n".join(rows) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
