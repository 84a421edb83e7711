# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # How many accelerometers does a calibration need?
#
# Notebook 02 showed what a moving platform adds to its plates. Here we plan the calibration
# recording, assess the fit, and determine how many accelerometers are needed. On your own machine,
# the same steps are `hbm calibration signals`, a recording, and `hbm calibration fit`.

# %%
import matplotlib.pyplot as plt
import numpy as np

from compensation import (
    MachineLimits,
    Signal,
    acceleration_spectrum,
    check_signal,
    check_trial,
    pitch_and_sway_signals,
    validation_signals,
)
from compensation.protocol import ADVISED_PLATFORM_SIGNAL
from pipeline.config.schema import Treadmill
from pipeline.figures.style import COLOURS
from pipeline.trial.ground.accelerometers import accelerations
from pipeline.trial.ground.calibration_recording import fit_calibration, plate_samples
from pipeline.virtual_lab.faults import AccelerometerFaults, Faults
from pipeline.virtual_lab.machine.instrumented_treadmill import make_treadmill
from pipeline.virtual_lab.machine.instruments import SENSOR_NAMES
from pipeline.virtual_lab.protocol.walking_trial import run_signal

components = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
cutoff_hz = 20.0

# %% [markdown]
# ## 1. A signal that the machine can follow
#
# Random sway and pitch, with quick moves and held positions in between. First check that the
# machine can follow it.
#
# Why this one of the 28 signals of the package? Not because it leaves less. In ten simulated
# laboratories (tests/validation/calibration_signals.md), calibrations with all
# variations left 1.02 times the RMS of plain random motion in trials that were not used for the fit
# (95 % interval 0.99–1.05), those with square waves of sway 1.04 (0.99–1.08), and belts at 3 m/s
# as much as belts at rest (1.00, 0.97–1.02); of the lateral force this one left a fifth more than
# plain random motion. But holding a tilted position gives the fit a constant component of gravity,
# and its sways and tilts are as quick and as far as any that the machine can do, so that trials
# hardly go beyond them. The study that this package reproduces found square waves of sway best, in
# one experiment; in ours, the best one varies between laboratories. `hbm calibration rank` ranks
# them on your machine, with the uncertainty of that one experiment.

# %%
drawn = {signal.name: signal for signal in pitch_and_sway_signals(seed=1, belt_speed=3.0)}
signal = drawn[ADVISED_PLATFORM_SIGNAL]
print("the default machine:", *check_signal(signal, MachineLimits()) or ["can do it"])
print(
    "a gentler machine:",
    *check_signal(signal, MachineLimits(sway_m_per_s2=2.0, pitch_deg_per_s=20.0)),
)
frequency, power = acceleration_spectrum(signal)

# %% [markdown]
# ## 2. The recording
#
# The treadmill is empty, its belts run, and four accelerometers are mounted on its frame; some of
# them are left out later. We also record trials that are not used for the fit: quick sway, slow
# pitch, and the platform at rest while the belts run, at the 1.3 m/s of these trials and the 3 m/s
# of the calibration, which shows the floor, the limit of any compensation.

# %%
virtual_treadmill = make_treadmill(Faults(accelerometers=AccelerometerFaults(sensors=4)), seed=1)
still = {
    speed: Signal("rest", 100.0, np.zeros(2000), np.zeros(2000), np.full(2000, speed))
    for speed in (1.3, 3.0)
}
validation = {other.name: other for other in validation_signals()}
recordings = {
    name: run_signal(virtual_treadmill, course, np.random.default_rng(seed))
    for seed, (name, course) in enumerate(
        {
            "calibration": signal,
            "sway": validation["sway"],
            "pitch": validation["pitch"],
            "rest": still[1.3],
            "rest at 3 m/s": still[3.0],
        }.items()
    )
}


def treadmill_with(sensors):
    """Describe a treadmill with some of the accelerometers."""
    return Treadmill(
        accelerometers={name: tuple(f"{name}.{axis}" for axis in "XYZ") for name in sensors},
        cutoff_hz=cutoff_hz,
    )


def of_plate_1(name, treadmill, calibration):
    """Give what the accelerometers felt, their delays undone, and what plate 1 measured of it."""
    return plate_samples(recordings[name], treadmill, calibration.sensors, None)["plate 1"]


# %% [markdown]
# ## 3. The fit and its quality

# %%
treadmill = treadmill_with(SENSOR_NAMES[:2])
calibration = fit_calibration(recordings["calibration"], treadmill)
model = calibration.plates["plate 1"]
floor, fast_floor = (
    np.std(of_plate_1(name, treadmill, calibration)[1], axis=0)
    for name in ("rest", "rest at 3 m/s")
)
print("two accelerometers, plate 1, on the calibration itself:")
for k, name in enumerate(components):
    print(
        f"  {name}: RMS {model.rms_measured[k]:6.1f} -> {model.rms_compensated[k]:5.2f},"
        f" R² {model.r_squared[k]:.4f}, floor {fast_floor[k]:.2f} {'N' if k < 3 else 'N·m'}"
    )
print(f"rank {model.rank} of {len(model.gain)}, condition {model.condition:.0f}")
print(*calibration.notes, sep="\n")

# %% [markdown]
# R² is the share of *this* recording that is explained. It is close to one because the machine
# moved a lot, and it does not predict the next trial. For that, use trials that were not part of
# the fit.
#
# Of Fx, Fz and My about as much is left as belts at 3 m/s show by themselves: rollers that are a
# little out of balance, which differ from start to start, and rumble. No compensation of the
# platform removes it. At the belt speed of the trials there is less.

# %% [markdown]
# ## 4. One, two, three or four accelerometers

# %%
remaining, before = {}, {}
for count in (1, 2, 3, 4):
    fewer = treadmill_with(SENSOR_NAMES[:count])
    fitted = fit_calibration(recordings["calibration"], fewer)
    for name in ("sway", "pitch"):
        felt, wrench = of_plate_1(name, fewer, fitted)
        before[name] = np.std(wrench, axis=0)
        remaining[name, count] = np.std(fitted.plates["plate 1"].compensate(felt, wrench), axis=0)
for name, measured in before.items():
    print(f"{name}: standard deviation      ", *(f"{c:>6}" for c in components))
    print("  measured               ", *(f"{v:6.2f}" for v in measured))
    for count in (1, 2, 3, 4):
        print(f"  {count} accelerometer(s)     ", *(f"{v:6.2f}" for v in remaining[name, count]))

# %% [markdown]
# One accelerometer is enough for sway, but not for pitch: a single sensor measures the platform's
# angle and its angular acceleration in the same channels and cannot distinguish them, so the fit is
# a compromise that suits its own recording. Fz becomes *larger* than measured. A second sensor at
# the other end of the platform resolves this.
#
# A third takes another fifth to a third off Fy and Mz in sway; the fourth hardly anything. What
# they add under people does not show in these trials. Two sensors do not show rotation about the
# line between them, and people who walk or run shake a platform in that direction too. A third that
# is not in line, and a fourth that is not in their plane, show it; their gains for it are learned
# from recordings of people beside the empty plate (`hbm calibration fit --beside`), as the signals
# move the platform in sway and pitch alone. How much that removes is in the documentation, under
# *Static and dynamic models of a moving platform*.
#
# There is a cost: components that were small before (Fx in sway) gain a tenth of a newton, the
# accelerometers' noise times the mass of the belt assembly.

# %% [markdown]
# ## 5. Limits of a calibration
#
# It is valid in the range in which it was recorded. When a trial exceeds that range, or a sensor
# failed or was remounted, `check_trial` returns warnings, and so do the notes of every trial.

# %%
acceleration = accelerations(recordings["sway"], treadmill)[1]
gentle = Signal("gentle", 100.0, 0.3 * signal.sway, 0.3 * signal.pitch, signal.belt_speed)
gentle_fit = fit_calibration(
    run_signal(virtual_treadmill, gentle, np.random.default_rng(9)), treadmill
)
dead, inverted = acceleration.copy(), acceleration.copy()
dead[:, 1] = acceleration[0, 1]
inverted[:, 3:] *= -1
for case, warnings in (
    ("full calibration", check_trial(model, acceleration)),
    ("gentle calibration", check_trial(gentle_fit.plates["plate 1"], acceleration)),
    ("a dead channel", check_trial(model, dead)),
    ("a sensor upside down", check_trial(model, inverted)),
):
    print(f"{case}: {'; '.join(map(str, warnings)) or 'no warning'}")

# %% [markdown]
# ## The picture
#
# Top: the commanded motion and the spectrum of its acceleration; a calibration identifies only what
# it excites. Bottom, for two trials that were not part of the fit: the empty plate as measured
# (vermilion) and with one to four accelerometers (light to dark blue), on a logarithmic scale, with
# the floor (dashed), which is another one in every recording. In pitch, Fz and My show why two
# sensors are the minimum.

# %%
figure, panels = plt.subplots(2, 2, figsize=(11, 7), layout="constrained")
time = np.arange(len(signal.sway)) / signal.rate_hz
panels[0, 0].plot(time, 100 * signal.sway, color=COLOURS["compensated"], label="sway (cm)", lw=1)
panels[0, 0].plot(
    time, np.degrees(signal.pitch), color=COLOURS["measured"], label="pitch (°)", lw=1
)
panels[0, 0].set(title="commanded motion", xlabel="time (s)")
panels[0, 0].legend(frameon=False, ncols=2)

density = panels[0, 1]
frequency = frequency[1:]
density.loglog(frequency, power[1:, 0], color=COLOURS["compensated"], label="sway (m/s²)²/Hz")
density.loglog(frequency, power[1:, 1], color=COLOURS["measured"], label="pitch (rad/s²)²/Hz")
density.axvline(cutoff_hz, color="grey", ls=":", label="cut-off of the fit")
density.set(title="acceleration spectra", xlabel="frequency (Hz)", xlim=(0.1, 50), ylim=(1e-6, 10))
density.legend(frameon=False)

place = np.arange(6)
for panel, (name, measured) in zip(panels[1], before.items(), strict=True):
    panel.bar(place - 0.36, measured, 0.18, color=COLOURS["measured"], label="measured")
    for count in (1, 2, 3, 4):
        panel.bar(
            place - 0.36 + 0.18 * count,
            remaining[name, count],
            0.18,
            color=COLOURS["compensated"],
            alpha=0.2 + 0.2 * count,
            label=f"{count} accelerometer{'s' if count > 1 else ''}",
        )
    panel.hlines(floor, place - 0.5, place + 0.5, color="black", ls="--", label="floor")
    panel.set_yscale("log")
    panel.set_xticks(place, components)
    panel.set(title=f"{name}: empty plate", ylabel="standard deviation (N, N·m)")
panels[1, 1].legend(frameon=False, fontsize=8)
figure.suptitle("Calibration signal, and the compensated plate with one to four accelerometers")
figure.savefig("03_calibrating_your_treadmill.png", dpi=100)
