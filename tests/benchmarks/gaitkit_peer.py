"""Gait events by gaitkit, in an interpreter that has it: ``python gaitkit_peer.py TRIAL.c3d …``.

Writes one JSON object: the version, and trial -> method -> label and side -> times [s].
"""

import json
import sys

METHODS = ("zeni", "bike", "ghoussayni", "oconnor", "hreljac")
"""Those of its ten methods that find strikes and offs in these recordings without training data."""
PARTS = {"heel": "HEE", "toe": "MT2", "ankle": "LM", "knee": "LEK", "hip": "ASIS"}
"""Its landmark -> marker of the Human Body Model; from the labels alone it takes another set."""
MARKERS = {
    f"{side}_{part}": letter + marker
    for side, letter in (("left", "L"), ("right", "R"))
    for part, marker in PARTS.items()
} | {"sacrum": ("LPSIS", "RPSIS")}
LISTS = {"foot_strike": "hs", "foot_off": "to"}


def events_of(gaitkit, path):
    """Give what every method finds in one recording."""
    trial = gaitkit.load_c3d(path, marker_map=MARKERS)
    found = {}
    for method in METHODS:
        result = gaitkit.detect(
            trial["angle_frames"], method=method, fps=trial["fps"], units={"position": "mm"}
        )
        found[method] = {
            f"{label} {side}": [float(e["time"]) for e in getattr(result, f"{side}_{name}")]
            for label, name in LISTS.items()
            for side in ("left", "right")
        }
    return found


def main():
    import gaitkit

    trials = {path: events_of(gaitkit, path) for path in sys.argv[1:]}
    json.dump({"version": gaitkit.__version__, "trials": trials}, sys.stdout)


if __name__ == "__main__":
    main()
