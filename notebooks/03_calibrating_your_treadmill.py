# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Calibrating your treadmill
#
# Notebook 02 showed what a moving platform does to its plates. Here we plan the recording that
# teaches the compensation, judge the fit, and ask how many accelerometers it takes.
# On your own machine the same steps are `hbm calibration signals`, a recording, and
# `hbm calibration fit`.

# %%
import matplotlib.pyplot as plt
import numpy as np

from compensation import (
    Limits,
    Signal,
    acceleration_spectrum,
    check_calibration,
    check_signal,
    check_trial,
    pitch_and_sway_signals,
    validation_signals,
)
from hbm.signals.filtering import low_pass
from pipeline.config.schema import Treadmill
from pipeline.figures.style import COLOURS
from pipeline.trial.ground.laboratory import accelerations, fit_calibration
from pipeline.virtual_lab.faults import AccelerometerFaults, Faults
from pipeline.virtual_lab.protocol.instrumented_treadmill import SENSORS, make_treadmill
from pipeline.virtual_lab.protocol.walking_trial import run_signal

components = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
cutoff_hz = 20.0

# %% [markdown]
# ## 1. A signal that the machine can follow
#
# Random sway and pitch, with quick moves and held positions in between. Ask first whether your
# machine can do it.
#
# Why this one of the 28 that the package writes? In ten simulated experiments the trials with all
# variations left 0.73 times the RMS that plain random motion left in trials the fit had not seen,
# those with held pitch 0.81, and those with square waves of sway 0.98 (95 % interval 0.97–1.00).
# Gravity turns with the platform for as long as it stands tilted, in random motion only for
# moments; sways are quick enough in it as they are. The study that this package repeats found
# square waves of sway best, in one experiment; in ours the winner changes from one to the next.
# `hbm calibration rank` tells which is best on your machine, and how sure that is.

# %%
drawn = {signal.name: signal for signal in pitch_and_sway_signals(seed=1, belt_speed=3.0)}
signal = drawn["all_60s_3mps"]
print("the default machine:", *check_signal(signal, Limits()) or ["can do it"])
print("a gentler machine:", *check_signal(signal, Limits(sway_m_per_s2=2.0, pitch_deg_per_s=20.0)))
spectrum = acceleration_spectrum(signal)

# %% [markdown]
# ## 2. The recording
#
# The treadmill is empty, its belts run, and four accelerometers are on its frame; we can leave out
# some of them later. We also record what the calibration has never seen: quick sway, slow pitch,
# and a machine at rest, which shows the noise floor: better than that nothing can become.

# %%
virtual_treadmill = make_treadmill(Faults(accelerometers=AccelerometerFaults(sensors=4)), seed=1)
still = Signal("rest", 100.0, np.zeros(2000), np.zeros(2000), np.full(2000, 3.0))
validation = {other.name: other for other in validation_signals()}
recordings = {
    name: run_signal(virtual_treadmill, course, np.random.default_rng(seed))
    for seed, (name, course) in enumerate(
        {
            "calibration": signal,
            "sway": validation["sway"],
            "pitch": validation["pitch"],
            "rest": still,
        }.items()
    )
}


def treadmill_with(sensors):
    """State which accelerometers there are."""
    return Treadmill(
        accelerometers={name: tuple(f"{name}.{axis}" for axis in "XYZ") for name in sensors},
        cutoff_hz=cutoff_hz,
    )


def plate_of(recording):
    """Give what plate 1 measures, low-passed as in the fit."""
    return low_pass(recording.plates[0].wrench_in_plate, 1000.0, cutoff_hz, "zero_phase")


# %% [markdown]
# ## 3. The fit, and how good it is

# %%
model = fit_calibration(recordings["calibration"], treadmill_with(SENSORS[:2])).plates["plate 1"]
floor = np.std(plate_of(recordings["rest"]), axis=0)
print("two accelerometers, plate 1, on the calibration itself:")
for k, name in enumerate(components):
    print(
        f"  {name}: RMS {model.rms_measured[k]:6.1f} -> {model.rms_compensated[k]:5.2f},"
        f" R² {model.r_squared[k]:.4f}, noise floor {floor[k]:.2f} {'N' if k < 3 else 'N·m'}"
    )
print(f"rank {model.rank} of {len(model.gain)}, condition {model.condition:.0f}")
print(*check_calibration(model, "plate 1"), sep="\n")

# %% [markdown]
# R² says how much of *this* recording is explained. It is close to one because the machine moved a
# lot, and it says nothing about the next trial. For that, look at trials that the fit never saw.

# %% [markdown]
# ## 4. One, two, three or four accelerometers

# %%
remaining = {}
for count in (1, 2, 3, 4):
    treadmill = treadmill_with(SENSORS[:count])
    fitted = fit_calibration(recordings["calibration"], treadmill).plates["plate 1"]
    for name in ("sway", "pitch"):
        recording = recordings[name]
        felt = low_pass(accelerations(recording, treadmill)[1], 1000.0, cutoff_hz, "zero_phase")
        left = fitted.compensate(felt, plate_of(recording))
        remaining[name, count] = np.std(left, axis=0)
before = {name: np.std(plate_of(recordings[name]), axis=0) for name in ("sway", "pitch")}
for name, measured in before.items():
    print(f"{name}: standard deviation      ", *(f"{c:>6}" for c in components))
    print("  measured               ", *(f"{v:6.2f}" for v in measured))
    for count in (1, 2, 3, 4):
        print(f"  {count} accelerometer(s)     ", *(f"{v:6.2f}" for v in remaining[name, count]))

# %% [markdown]
# One accelerometer is enough for sway. In pitch it is not: a single sensor feels the platform's
# angle and its angular acceleration through the same channels and cannot tell them apart, so the
# fit settles on a compromise that suits its own recording. Fz comes out *worse* than it was
# measured. The second sensor, at the other end of the platform, settles that. A third and fourth
# only average noise.
#
# Notice the price as well: components that were quiet to begin with (Fx in sway) gain a few
# tenths of a newton, the accelerometers' noise times the mass of the belt.

# %% [markdown]
# ## 5. What a calibration does not know
#
# It holds where it has been. A trial that moves more than the calibration did, or in which a sensor
# died or was remounted, is not silently compensated: `check_trial` says so, and so does every
# trial's list of notes.

# %%
treadmill = treadmill_with(SENSORS[:2])
felt = accelerations(recordings["sway"], treadmill)[1]
gentle = Signal("gentle", 100.0, 0.3 * signal.sway, 0.3 * signal.pitch, signal.belt_speed)
timid = fit_calibration(run_signal(virtual_treadmill, gentle, np.random.default_rng(9)), treadmill)
dead, turned = felt.copy(), felt.copy()
dead[:, 1] = felt[0, 1]
turned[:, 3:] *= -1
for what, found in (
    ("full calibration", check_trial(model, felt)),
    ("timid calibration", check_trial(timid.plates["plate 1"], felt)),
    ("a dead channel", check_trial(model, dead)),
    ("a sensor upside down", check_trial(model, turned)),
):
    print(f"{what}: {'; '.join(map(str, found)) or 'no warning'}")

# %% [markdown]
# ## The picture
#
# Above: what the machine is told, and where in frequency its acceleration is. A calibration can
# only teach what it excites. Below, for two trials that the fit never saw: the empty plate as
# measured (vermilion) and with one to four accelerometers (light to dark blue), on a logarithmic
# scale. The dashes are the noise floor. In pitch, Fz and My show why two sensors are the least.

# %%
figure, panels = plt.subplots(2, 2, figsize=(11, 7), layout="constrained")
time = np.arange(len(signal.sway)) / signal.rate_hz
panels[0, 0].plot(time, 100 * signal.sway, color=COLOURS["compensated"], label="sway (cm)", lw=1)
panels[0, 0].plot(
    time, np.degrees(signal.pitch), color=COLOURS["measured"], label="pitch (°)", lw=1
)
panels[0, 0].set(title="what the machine is told", xlabel="time (s)")
panels[0, 0].legend(frameon=False, ncols=2)

density = panels[0, 1]
frequency = spectrum.frequency[1:]
density.loglog(frequency, spectrum.sway[1:], color=COLOURS["compensated"], label="sway (m/s²)²/Hz")
density.loglog(frequency, spectrum.pitch[1:], color=COLOURS["measured"], label="pitch (rad/s²)²/Hz")
density.axvline(cutoff_hz, color="grey", ls=":", label="cutoff of the fit")
density.set(title="its accelerations", xlabel="frequency (Hz)", xlim=(0.1, 50), ylim=(1e-6, 10))
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
    panel.hlines(floor, place - 0.5, place + 0.5, color="black", ls="--", label="noise floor")
    panel.set_yscale("log")
    panel.set_xticks(place, components)
    panel.set(title=f"left over in {name}", ylabel="standard deviation (N, N·m)")
panels[1, 1].legend(frameon=False, fontsize=8)
figure.suptitle("Calibrating a treadmill: the signal, and what one to four accelerometers leave")
figure.savefig("03_calibrating_your_treadmill.png", dpi=100)
