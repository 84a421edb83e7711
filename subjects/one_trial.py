"""One trial, from a recording to its pelvis residuals, with everything stated here.

    python subjects/one_trial.py [STUDY]

No study file is read: what study.toml and a subject's file would state is typed below. Copy this
script for a recording of your own that belongs to no study.
"""

import sys
from pathlib import Path

import hbm_residuals as hr

study = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent

# What was recorded: markers, force plates, accelerometers and gait events, in one C3D file.
recording = hr.read(study / "sub01_pitch.c3d")

# Who walked, how to process, and which gait cycles are used: the first 50 at constant belt speed.
# The mass is measured: the recording begins with a T-pose on the plates, from which
# joint centres and segments are taken, too.
subject = hr.Subject(id="sub01", sex="male", height_m=1.85)
settings = hr.Settings(cutoff_hz=6.0, filter="zero_phase", marker_set="hbm2")
condition = hr.Condition(cycles=50, skip_s=10.0)

# The treadmill: which channels are the accelerometers on its frame, and which markers show its
# pose. A recording of the moving, empty treadmill says what its own inertia adds to the plates, and
# recordings of people beside an empty plate what they add by shaking it.
treadmill = hr.Treadmill(
    accelerometers={
        "rear_left": ("rear_left.X", "rear_left.Y", "rear_left.Z"),
        "front_right": ("front_right.X", "front_right.Y", "front_right.Z"),
    },
    platform=hr.Platform(markers=("ROT_REF", "ROT_C1", "ROT_C2", "ROT_C3", "ROT_C4")),
)
people = ("walking_right", "walking_left", "running_right", "running_left", "boards")
calibration = hr.read_calibration(
    study / "calibration.c3d",
    treadmill,
    beside=tuple(study / f"{name}.c3d" for name in people),
)
laboratory = hr.Laboratory(treadmill, calibration)

# Body, inverse kinematics, filter, compensation, inverse dynamics, gait cycles.
result = hr.process(recording, subject, settings, laboratory=laboratory, condition=condition)

# What was inferred, interpolated or left out; docs/notes.md explains each warning.
for note in result.notes:
    print(f"- {note} [{note.code}]")

# Residuals over the gait cycles, in N and N·m, with the plates as measured and compensated:
# x forward, y to the right, z up; moments about mid-hip.
table = hr.residuals(result, "pitch")
columns = ["subject", "condition", "compensated", "axis", "unit", "rms", "peak", "n_cycles"]
print(table[columns].round(1).to_string(index=False))
