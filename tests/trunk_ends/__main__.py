"""Tables of the comparison: ``python -m tests.trunk_ends FOLDER`` with the real recordings."""

import sys
from pathlib import Path

import numpy as np

from hbm.body import Body
from hbm.spatial import GRAVITY_MPS2
from tests.trunk_ends.choices import CHOICES, with_ends
from tests.trunk_ends.generated_model import our_trunk, true_trunk
from tests.trunk_ends.recordings import CASES, Case


def bodies(case: Case) -> dict[str, Body]:
    """Give the body with each choice that its markers allow."""
    found = {}
    for choice in CHOICES:
        try:
            found[choice] = with_ends(case.body, choice, case.calibration, case.measures)
        except KeyError:
            continue
    return found


def main(data: Path) -> None:
    """Print all tables as Markdown."""
    cases = {title: load(data) for title, load in CASES.items()}
    choices = {title: bodies(case) for title, case in cases.items()}
    print("Root mean square of the pelvis residual\n")
    print("| recording | end points | Fx N | Fy N | Fz N | Mx N·m | My N·m | Mz N·m |")
    print("|---|---|---|---|---|---|---|---|")
    for title, case in cases.items():
        for choice, body in choices[title].items():
            rms = np.sqrt(np.mean(case.residual(body) ** 2, axis=0))
            print(f"| {title} | {choice} | " + " | ".join(f"{x:.2f}" for x in rms) + " |")

    print("\nUpper trunk\n")
    print("| recording | end points | centre on the axis mm | largest moment of inertia kg·m² |")
    print("|---|---|---|---|")
    for title, each in choices.items():
        old = each["midpoints"].segments["thorax"]
        for choice, body in each.items():
            if choice == "CERV-XYPH, head to C7":
                continue
            part = body.segments["thorax"]
            shift = 1000 * (part.center - old.center)[2]
            moment = np.linalg.eigvalsh(part.tensor)[2]
            print(f"| {title} | {choice} | {shift:+.0f} | {moment:.3f} |")

    print("\nQuiet standing: the centre of mass behind the centre of pressure\n")
    print("| end points | My N·m | mm |")
    print("|---|---|---|")
    case = cases["quiet standing"]
    for choice, body in choices["quiet standing"].items():
        pitch = case.residual(body)[:, 4].mean()
        print(f"| {choice} | {pitch:.2f} | {1000 * pitch / (body.mass * GRAVITY_MPS2):.1f} |")

    print("\nGenerated walk: pelvis, trunk and head about mid-hip, mean\n")
    print("| end points | mass kg | centre above mm | ahead mm | about the transverse axis kg·m² |")
    print("|---|---|---|---|---|")
    case, model = cases["generated walk"], data / "truth_walk" / "subject01.osim"
    frames = np.flatnonzero(case.counted)[::10]
    rows = {"the model's own": [true_trunk(model, case.markers, t) for t in frames]}
    for choice, body in choices["generated walk"].items():
        rows[choice] = [our_trunk(body, case.motion, case.markers, t) for t in frames]
    for choice, parts in rows.items():
        ahead, _, above = 1000 * np.mean([part.center for part in parts], axis=0)
        about = np.mean(
            [
                part.tensor[1, 1] + part.mass * (part.center[0] ** 2 + part.center[2] ** 2)
                for part in parts
            ]
        )
        print(f"| {choice} | {parts[0].mass:.1f} | {above:.0f} | {ahead:.0f} | {about:.2f} |")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
