"""What an empty plate measures while somebody runs on the other belt."""

import numpy as np

from pipeline.virtual_lab.analysis.empty_plate import FORCES, THESIS_RUNNING_N, beside_a_runner


def test_the_thesis_empty_plate_is_that_of_a_machine_up_to_four_times_as_flexible_as_the_default():
    """Table II, row Running; no cell of Table III."""
    found = beside_a_runner([1.0, 4.0, 13.9]).set_index(["flexibility", "filtered"])
    forces = found[list(FORCES)] / np.array(THESIS_RUNNING_N)
    assert (forces.loc[1.0, True] < 1).all()
    assert (forces.loc[1.0, False] < 1.3).all()
    assert (forces.loc[4.0, True] < 1.4).all()
    assert (forces.loc[4.0, False] > 1).all()
    assert (forces.loc[13.9, True] > 3.0).all()
    softness = found.index.get_level_values("flexibility").to_numpy()
    assert (found["sway_hz"] ** 2 * softness).std() < 0.01
