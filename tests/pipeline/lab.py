"""A laboratory made of numbers: a platform that sways and pitches under a virtual walker.

The walker's wrench on the ground is known exactly (`pipeline.virtual_lab`); it does not care about
what the platform does. The plates measure it in their own moving frame, plus what it takes to carry
and accelerate the belt assemblies on them. All this is rigid-body mechanics in platform axes,
written here a second time and independently of `compensation`.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.interpolate import make_interp_spline

from hbm.markers import Markers
from hbm.signals.resampling import interpolate
from hbm.spatial import GRAVITY_MPS2, Array, rotation_about, transform_wrench
from pipeline.io.c3d.force_plates import plate_axes
from pipeline.io.c3d.read import read_c3d
from pipeline.io.recording import Analog, Plate, Recording
from pipeline.virtual_lab.machine.c3d_file import write_c3d
from pipeline.virtual_lab.person.subject import Person
from pipeline.virtual_lab.protocol.walking_trial import simulate_trial

LEFT = np.array([0.0, 1.0, 0.0])
PIVOT_M = np.array([0.1, 0.0, -0.4])
ASSEMBLY_KG = 150.0
ASSEMBLY_COM_M = np.array([0.02, 0.01, -0.15])  # from the centre of the plate's surface
ASSEMBLY_INERTIA = np.diag([6.0, 40.0, 42.0])
SENSORS_M = {"rear_left": np.array([-0.9, 0.5, -0.2]), "front_right": np.array([0.9, -0.5, -0.1])}
CHANNELS = {"rear_left": ("Acc1.X", "Acc1.Y", "Acc1.Z"), "front_right": ("A2X", "A2Y", "A2Z")}
PLATFORM_MARKERS_M = {
    "PF1": np.array([1.1, 0.7, 0.05]),
    "PF2": np.array([1.1, -0.7, 0.0]),
    "PF3": np.array([-1.1, -0.7, 0.1]),
    "PF4": np.array([-1.1, 0.7, 0.0]),
}
STEP_M, STEP_S = 0.05, 0.3125  # the quintic's fastest is 1.875 · 5 cm / 0.3125 s = 0.30 m/s
PULSE_S = 0.05


@dataclass(frozen=True)
class PlatformMotion:
    """Sway and pitch over time, (N,), at 1000 Hz."""

    time: Array
    sway: Array
    pitch: Array

    @cached_property
    def splines(self):
        return [make_interp_spline(self.time, x, k=5) for x in (self.sway, self.pitch)]

    def at(self, t):
        """Give sway, pitch and their first two derivatives at any times."""
        inside = np.clip(t, self.time[0], self.time[-1])
        return [[spline(inside, k) for k in range(3)] for spline in self.splines]

    def pose(self, t):
        (sway, _, _), (pitch, _, _) = self.at(t)
        rotation = rotation_about(LEFT, pitch)
        return rotation, sway[:, None] * LEFT + PIVOT_M - rotation @ PIVOT_M

    def specific_force(self, point, t):
        """Acceleration minus gravity of a point of the platform, in platform axes, (N, 3)."""
        (_, _, sway2), (pitch, pitch1, pitch2) = self.at(t)
        arm = point - PIVOT_M
        about = np.cross(pitch2[:, None] * LEFT, arm)
        about += np.cross(pitch1[:, None] * LEFT, np.cross(pitch1[:, None] * LEFT, arm))
        back = np.swapaxes(rotation_about(LEFT, pitch), 1, 2)
        return about + sway2[:, None] * LEFT + back @ np.array([0, 0, GRAVITY_MPS2])

    def assembly_wrench(self, center, t):
        """What the cells of a plate add for its belt assembly, zeroed in neutral, (N, 6)."""
        _, (_, pitch1, pitch2) = self.at(t)
        force = ASSEMBLY_KG * self.specific_force(center + ASSEMBLY_COM_M, t)
        spin = pitch1[:, None] * LEFT
        moment = np.cross(ASSEMBLY_COM_M, force) + pitch2[:, None] * (ASSEMBLY_INERTIA @ LEFT)
        moment += np.cross(spin, spin @ ASSEMBLY_INERTIA)
        tare = ASSEMBLY_KG * GRAVITY_MPS2 * np.array([0, 0, 1.0])
        still = np.concatenate([tare, np.cross(ASSEMBLY_COM_M, tare)])
        return np.hstack([force, moment]) - still


def ramp(x):
    x = np.clip(x, 0, 1)
    return x**3 * (10 - 15 * x + 6 * x**2)


def analog_clock(duration_s):
    return np.arange(round(duration_s * 1000)) / 1000


def still(duration_s):
    t = analog_clock(duration_s)
    return PlatformMotion(t, 0 * t, 0 * t)


def pitching(duration_s, *, degrees=10.0, period_s=6.0):
    t = analog_clock(duration_s)
    return PlatformMotion(
        t, 0 * t, np.radians(degrees) * ramp((t - 2) / 2) * np.sin(2 * np.pi * t / period_s)
    )


def swaying(duration_s, onsets):
    """Sways 5 cm to the left at each onset, fast, and slowly back from one second later."""
    t = analog_clock(duration_s)
    out = [ramp((t - at) / STEP_S) - ramp((t - at - 1.0) / 2.0) for at in onsets]
    return PlatformMotion(t, STEP_M * np.sum(out, axis=0), 0 * t)


def shaken(duration_s, seed=7):
    """Moves widely in sway and pitch: what a calibration needs."""
    t = analog_clock(duration_s)
    rng = np.random.default_rng(seed)
    slow = ramp((t - 1.5) / 2) * ramp((duration_s - t) / 2)

    def noise(size):
        rates = rng.uniform(0.1, 1.5, 12)
        waves = np.sin(2 * np.pi * rates * t[:, None] + rng.uniform(0, 6, 12)) / rates
        signal = waves.sum(axis=1)
        return size * slow * signal / np.abs(signal).max()

    return PlatformMotion(t, noise(0.05), noise(np.radians(10)))


def walk(folder, *, duration_s=12.0, seed=0, person=None, marker_noise_m=0.0003):
    """Give a virtual walker's trial on a treadmill that stands still, without plate noise."""
    path = Path(folder) / f"walk_{seed}.c3d"
    simulate_trial(
        path,
        duration_s=duration_s,
        seed=seed,
        person=person,
        marker_noise_m=marker_noise_m,
        plate_noise_n=0,
    )
    return read_c3d(path)


def without_people(duration_s):
    """Give a recording of an empty treadmill: two plates, no markers."""
    t = analog_clock(duration_s)
    frames = t[::10]
    nobody = Markers(frames, (), np.empty((len(frames), 0, 3)))
    surface = np.array([[0.9, 0.25, 0], [0.9, -0.25, 0], [-0.9, -0.25, 0], [-0.9, 0.25, 0]])
    plates = [
        Plate(
            number=k + 1,
            time=t,
            wrench_in_plate=np.zeros((len(t), 6)),
            rotation=plate_axes(surface),
            center=(0, y, 0),
            corners=surface + np.array([0, y, 0]),
        )
        for k, y in enumerate((0.25, -0.25))
    ]
    return Recording(Path("empty.c3d"), nobody, tuple(plates))


def on_platform(
    recording,
    motion,
    *,
    pulses=(),
    plate_delay_s=0.0,
    accelerometer_delay_s=0.0,
    command_delay_s=0.0,
    assembly=True,
    noise=1.0,
    seed=0,
):
    """Give the same people on a moving platform, as its instruments record them.

    A delay is how much later a device stamps what happens; plates, accelerometers and the
    platform's commands have their own.
    """
    rng = np.random.default_rng(seed)
    clock = recording.plates[0].time
    real = clock - plate_delay_s
    rotation, position = motion.pose(real)
    plates = []
    for plate in recording.plates:
        acting = interpolate(clock, plate.wrench, np.clip(real, clock[0], clock[-1]))
        back = np.swapaxes(rotation, 1, 2)
        seen = transform_wrench(acting, back, -(back @ position[..., None])[..., 0])
        local = transform_wrench(seen, plate.rotation.T, -plate.rotation.T @ plate.center)
        belt = motion.assembly_wrench(plate.center, real) * assembly
        belt = transform_wrench(belt, plate.rotation.T, np.zeros(3))
        grain = rng.normal(0, noise, local.shape) * [0.5, 0.5, 0.5, 0.1, 0.1, 0.1]
        plates.append(replace(plate, wrench_in_plate=local + belt + grain))

    columns, names, units = [], [], []
    felt_at = clock - accelerometer_delay_s
    for sensor, point in SENSORS_M.items():
        felt = motion.specific_force(point, felt_at) + rng.normal(0, 0.002 * noise, (len(clock), 3))
        columns += [*(felt.T / 9.80665)]
        names += CHANNELS[sensor]
        units += ["g"] * 3
    (sway, _, _), (pitch, _, _) = motion.at(clock - command_delay_s)
    pulse = np.zeros(len(clock))
    for at in pulses:
        pulse[(clock >= at) & (clock < at + PULSE_S)] = 5.0
    pulse += rng.normal(0, 0.01 * noise, len(clock))
    columns += [sway * 1000, np.degrees(pitch), pulse]
    names += ["Sway", "Pitch", "Pulse"]
    units += ["mm", "deg", "V"]
    analog = Analog(clock, tuple(names), tuple(units), np.column_stack(columns))

    frames = recording.markers.time
    turn, shift = motion.pose(frames)
    onboard = np.stack([(turn @ p) + shift for p in PLATFORM_MARKERS_M.values()], axis=1)
    onboard += rng.normal(0, 0.0002 * noise, onboard.shape)
    markers = Markers(
        frames,
        (*recording.markers.names, *PLATFORM_MARKERS_M),
        np.concatenate([recording.markers.position, onboard], axis=1),
    )
    return replace(recording, markers=markers, plates=tuple(plates), analog=analog)


PEOPLE = (
    Person("sub01"),
    Person("sub02", sex="female", mass_kg=61.0, height_m=1.66, age=24.0),
)
STUDY = f"""
name = "Moving numbers"
[treadmill]
calibration = "empty.c3d"
[treadmill.accelerometers]
{"".join(f"{sensor} = {list(channels)}" + chr(10) for sensor, channels in CHANNELS.items())}
[treadmill.platform]
markers = {list(PLATFORM_MARKERS_M)}
[conditions.baseline]
cycles = 4
skip_s = 6.0
[conditions.sway]
cycles = 2
perturbed = true
pulse_channel = "Pulse"
[conditions.pitch]
cycles = 4
skip_s = 6.0
"""
SWAYS_S = (6.5, 9.7)


def write_study(folder, *, people=PEOPLE, duration_s=12.0):
    """Write a whole study: a calibration, and baseline, sway and pitch of every person."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "study.toml").write_text(STUDY, encoding="utf-8")
    save(on_platform(without_people(20.0), shaken(20.0)), folder / "empty.c3d")
    motions = {
        "baseline": still(duration_s),
        "sway": swaying(duration_s, SWAYS_S),
        "pitch": pitching(duration_s),
    }
    for number, person in enumerate(people):
        walker = walk(folder, duration_s=duration_s, seed=number, person=person)
        walker.source.unlink()
        lines = [f'id = "{person.name}"', f'sex = "{person.sex}"', f"age_years = {person.age}"]
        for condition, motion in motions.items():
            name = f"{person.name}_{condition}.c3d"
            pulses = SWAYS_S if condition == "sway" else ()
            save(on_platform(walker, motion, pulses=pulses, seed=number), folder / name)
            lines += [f"[trials.{condition}]", f'file = "{name}"']
        (folder / f"{person.name}.toml").write_text("\n".join(lines), encoding="utf-8")
    return folder


def edit(path, old, new):
    """Replace a text in a file, which has to be there."""
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")


def save(recording, path):
    """Write a recording as C3D."""
    write_c3d(
        path,
        recording.markers,
        recording.plates,
        analog=recording.analog,
        events=recording.events,
        metadata=recording.metadata,
    )
    return path


def without_channels(recording, *channels):
    """The recording without some of its analog channels."""
    analog = recording.analog
    kept = [k for k, name in enumerate(analog.names) if name not in channels]
    names, units = (tuple(x[k] for k in kept) for x in (analog.names, analog.units))
    fewer = replace(analog, names=names, units=units, values=analog.values[:, kept])
    return replace(recording, analog=fewer)


def cropped(recording, first, last):
    """The frames ``first`` to ``last`` of a recording, from time zero on, with its events."""
    markers = recording.markers
    start, stop = markers.time[[first, last]]
    before, after = start - 0.25 / markers.rate_hz, stop + 0.95 / markers.rate_hz

    def part(signal, values):
        inside = (signal.time >= before) & (signal.time < after)
        content = {"time": signal.time[inside] - start, values: getattr(signal, values)[inside]}
        return replace(signal, **content)

    kept = slice(first, last + 1)
    return replace(
        recording,
        markers=Markers(markers.time[kept] - start, markers.names, markers.position[kept]),
        plates=tuple(part(plate, "wrench_in_plate") for plate in recording.plates),
        analog=part(recording.analog, "values") if recording.analog else None,
        events=tuple(
            replace(event, time=event.time - start)
            for event in recording.events
            if start <= event.time <= stop
        ),
    )


def cropped_at_strikes(recording, events, *, count):
    """Crop a recording between heel strikes; gives first frame and what is left, each.

    The first strikes become the start and the last ones the end, so that at least half is left.
    """
    strikes = sorted(event.time for event in events if event.label == "foot_strike")
    begins = np.searchsorted(recording.markers.time, strikes, side="right") - 1
    ends = np.searchsorted(recording.markers.time, strikes)
    for first, last in zip(begins[:count], ends[-count:], strict=True):
        yield first, cropped(recording, first, last)
