"""A study to start from: commented TOML files."""

from pathlib import Path
from typing import Final

STUDY: Final = """\
# A study: what the laboratory is, how trials are processed, which conditions there are.
# Every other TOML file in this folder is a subject. File names are relative to this folder.
# Units stand in the names of the keys. 'hbm check .' tells what is missing.

name = "My study"

# Where the files' x, y and z axes point in the lab. Leave out to have it inferred and stated.
# axes = "left,back,up"

# Labels in the files that are spelt otherwise than in the marker set.
# [rename]
# LASI = "LASIS"

[settings]
# marker_set = "hbm2"        # hbm2, hbm2_lower, hbm1, hbm1_lower or a TOML file of your own
cutoff_hz = 6.0              # of the Butterworth filter, on coordinates and forces alike
filter = "zero_phase"        # or "realtime", as the laboratory's own software does
hip = "harrington"           # joint centres by Harrington (2007), "bell" (1990) or "functional"
# marker_offset_m = 0.009    # from the skin to a marker's centre
plate_delay_s = 0.0          # how much later the plates are stamped than the markers
# contact_threshold_n = 30.0 # vertical force above which a foot is on a plate

[treadmill]
# Recording of the empty, moving treadmill (.c3d), or a calibration fitted to one (.json).
# calibration = "calibration.c3d"
# accelerometer_unit = "g"   # if the files do not say it
# accelerometer_range_g = 2.0  # where they clip
# accelerometer_delay_s = 0.0  # how much later the accelerometers are stamped than the plates
# cutoff_hz = 20.0           # low-pass for fitting the calibration

# [treadmill.accelerometers] # sensor = its x, y and z channels
# rear_left = ["Acc1.X", "Acc1.Y", "Acc1.Z"]
# front_right = ["Acc2.X", "Acc2.Y", "Acc2.Z"]

# [treadmill.belt]           # if the belts accelerate: taken off before sway and pitch
# calibration = "belts.c3d"  # the empty treadmill, belts accelerating at random
# speed_channels = ["Belt.Left", "Belt.Right"]  # one per plate, or one for all
# cutoff_hz = 10.0           # low-pass on belt acceleration and pitch moment

# [treadmill.platform]       # leave out for a treadmill that stands still
# markers = ["PLAT1", "PLAT2", "PLAT3", "PLAT4"]
# or, less exact, as commanded; sway to the left and pitch with the front going down are positive:
# sway_channel = "Sway"
# pitch_channel = "Pitch"
# pivot_m = [0.0, 0.0, -0.3] # a point of the pitch axis, in the lab
# delay_s = 0.0              # how much later the channels are stamped than the markers see it;
#                            # negative where the platform follows its command late

[conditions.baseline]
cycles = 50                  # gait cycles that count
skip_s = 10.0                # leave out the start

[conditions.sway]
cycles = 20
perturbed = true             # only cycles that contain a perturbation
pulse_channel = "Perturbation"   # rises when one starts; default: the platform's motion

[conditions.pitch]
cycles = 50
skip_s = 10.0
"""

SUBJECT: Final = """\
# One subject. Copy this file for every further one.
id = "sub01"
sex = "female"               # male, female or unspecified
height_m = 1.70
# mass_kg = 65.0             # default: weighed by the plates in the first 100 frames
# age_years = 26
# knee_width_m = 0.105       # these two stand in for medial markers that are not there; default:
# ankle_width_m = 0.072      # the file's, or estimated from the shank
# static = "sub01_static.c3d"      # calibration pose; default: the quietest second of each trial
# hip_trial = "sub01_star.c3d"     # where hip is "functional": both thighs swing in it
# segments = "sub01_segments.toml" # what is known of segments: prostheses, braces, shoes, scans

# A file of segments holds a table for each, such as [left_shank], with any of mass_kg = 1.9, of
# the centre of mass from the proximal joint, center_m = [0.0, 0.0, -0.11] (forward, left, up when
# standing), and of inertia_kg_m2 = [0.021, 0.021, 0.002] about it; [right_foot.worn], with mass_kg
# and center_m, adds what the segment carries, such as a shoe.

[trials.baseline]
file = "sub01_baseline.c3d"

# forces = "sub01_baseline.mot"    # where file is a .trc: the ground reaction forces
# record = "sub01_record.txt"      # where file is D-Flow's mocap text: its record module's file

[trials.sway]
file = "sub01_sway.c3d"

[trials.pitch]
# A trial that cannot be used stays in the table, with its reason:
exclude = "not recorded yet"
"""


def write_template(folder: Path) -> tuple[Path, Path]:
    """Write a commented study.toml and a subject file.

    Parameters
    ----------
    folder
        Where; made if it does not exist.

    Returns
    -------
    tuple of Path
        The two files.

    Raises
    ------
    ValueError
        If there already is a study; nothing is overwritten.
    """
    study, subject = folder / "study.toml", folder / "sub01.toml"
    for path in (study, subject):
        if path.exists():
            raise ValueError(f"{path} is already there; nothing was written")
    folder.mkdir(parents=True, exist_ok=True)
    study.write_text(STUDY, encoding="utf-8")
    subject.write_text(SUBJECT, encoding="utf-8")
    return study, subject
