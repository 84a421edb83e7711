"""Plates in wrong units are refused with the units that are right; healthy ones are not accused."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hbm.markers import Markers
from hbm.spatial import GRAVITY_MPS2, shift_wrench
from pipeline.io.mended_plates import with_mended_plates
from pipeline.io.read_options import ReadOptions
from pipeline.io.recording import Plate, Recording
from pipeline.trial.plate_units import require_units, reversed_plates
from pipeline.trial.study_files import saying_what_was_read

TIME = np.arange(300) / 100
SIZE = np.array([[0.5, 0.9, 0], [-0.5, 0.9, 0], [-0.5, -0.9, 0], [0.5, -0.9, 0]]) / 2


def steps(mass_kg, lever, power=0, force_power=0, units="N,Nmm", plates=2):
    """Somebody who steps on plates in turn, whose channels are too small by powers of ten.

    The pressure moves in both directions: no lever makes a moment exactly zero, as a dead one is.
    """
    feet, made = np.full((len(TIME), 4, 3), np.nan), []
    for k in range(plates):
        center = np.array([0.0, 0.55 * k - 0.25, 0.0])
        on = np.sin(np.pi * (TIME - 1.4 * k) / 1.2)
        on = np.where((1.4 * k < TIME) & (1.4 * k + 1.2 > TIME), on, 0.0)
        heel = center + np.array([0.28, 0.06, 0.0]) - np.outer(TIME - 1.4 * k, [0.4, 0, 0])
        loaded = on > 0
        feet[loaded, 2 * k % 4] = heel[loaded] + np.array([0, 0, 0.04])
        feet[loaded, 2 * k % 4 + 1] = heel[loaded] + np.array([0.2, 0, 0.05])
        pressure = heel + np.outer(np.clip((TIME - 1.4 * k) / 1.2, 0, 1), [0.2, 0.01, 0]) - center
        force = np.outer(on, mass_kg * GRAVITY_MPS2 * np.array([0.05, 0.02, 1.1]))
        wrench = np.hstack([force, np.cross(pressure, force)])
        stored = shift_wrench(wrench, lever)
        rng = np.random.default_rng(k)
        stored += rng.normal(size=stored.shape) * 1e-3 * np.abs(stored).max(axis=0)
        stored *= 10.0 ** -np.repeat([force_power, power], 3)
        wrench = shift_wrench(stored, -np.asarray(lever))
        made.append(
            Plate(k + 1, TIME, wrench, np.eye(3), center, SIZE + center, units, np.asarray(lever))
        )
    markers = Markers(TIME, ("LHEE", "LTOE", "RHEE", "RTOE"), feet)
    return Recording("steps.c3d", markers, tuple(made))


LEVERS = st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(-0.2, 0.0)).map(np.array)


@given(mass_kg=st.floats(20, 150), lever=LEVERS, known=st.booleans())
def test_plates_in_right_units_are_not_accused(mass_kg, lever, known):
    require_units(steps(mass_kg, lever), mass_kg if known else None)


@given(
    mass_kg=st.floats(20, 150),
    lever=LEVERS,
    units=st.sampled_from([("Nmm", "Nm", 3), ("Nm", "Nmm", -3), ("Nm", "Ncm", -2)]),
)
def test_moments_in_another_unit_are_refused_with_the_right_one(mass_kg, lever, units):
    said, right, power = units
    wrong = steps(mass_kg, lever, power, units=f"N,{said}")
    with pytest.raises(ValueError, match=rf"1, 2: moments 10.*--plate-units N,{right},"):
        require_units(wrong)


@given(mass_kg=st.floats(30, 120), lever=LEVERS, known=st.booleans())
def test_forces_in_kilonewtons_are_refused_whoever_says_the_mass(mass_kg, lever, known):
    wrong = steps(mass_kg, lever, force_power=3)
    with pytest.raises(ValueError, match=r"1, 2: forces 1000 .*--plate-units kN,Nmm,"):
        require_units(wrong, mass_kg if known else None)
    wrong = steps(mass_kg, lever, force_power=-3, units="kN,Nmm")
    with pytest.raises(ValueError, match=r"1000 .*too large.*--plate-units N,Nmm,"):
        require_units(wrong, mass_kg if known else None)


@given(mass_kg=st.floats(20, 150), lever=LEVERS, power=st.sampled_from([-3, 3]))
def test_one_plate_in_another_unit_is_refused_with_gains_that_mend_it(mass_kg, lever, power):
    sound, wrong = steps(mass_kg, lever), steps(mass_kg, lever, power)
    plates = (sound.plates[0], wrong.plates[1])
    with pytest.raises(ValueError, match=r"2: moments 1000 .*\"2: gain Mx") as error:
        require_units(replace(sound, plates=plates))
    gains = [f"2: gain {name} {10.0**power:g}" for name in ("Mx", "My", "Mz")]
    assert all(gain in str(error.value) for gain in gains)
    mended = with_mended_plates(
        replace(sound, plates=plates, options=ReadOptions(mend_plates=tuple(gains)))
    )
    require_units(mended)
    np.testing.assert_allclose(
        mended.plates[1].wrench_in_plate, sound.plates[1].wrench_in_plate, atol=0.01 * mass_kg
    )


@given(mass_kg=st.floats(20, 150), of_one=st.sampled_from([(3, 1e3), (4, 1e-3)]))
def test_one_moment_in_another_unit_is_refused_without_a_gain_for_it(mass_kg, of_one):
    component, factor = of_one
    recording = steps(mass_kg, np.zeros(3))
    wrench = recording.plates[0].wrench_in_plate.copy()
    wrench[:, component] *= factor
    plates = (replace(recording.plates[0], wrench_in_plate=wrench), recording.plates[1])
    with pytest.raises(ValueError, match=r"plate 1: .*different units.*channels") as error:
        require_units(replace(recording, plates=plates))
    assert "mend_plates" not in str(error.value)


@given(mass_kg=st.floats(20, 150), lever=LEVERS)
def test_centres_of_pressure_in_another_unit_are_refused_with_the_third_unit(mass_kg, lever):
    wrong = steps(mass_kg, np.zeros(3), 3, units="N,Nmm,mm")
    with pytest.raises(ValueError, match=r"give --plate-units N,Nmm,m,"):
        require_units(wrong)


@given(mass_kg=st.floats(30, 150), known=st.booleans())
def test_plates_that_weigh_a_tenth_of_a_body_are_refused_with_the_factor(mass_kg, known):
    wrong = steps(mass_kg, np.zeros(3), power=1, force_power=1)
    if known or 1.1 * mass_kg < 90:
        with pytest.raises(ValueError, match=r"1, 2: forces 10 .*small, .*channels"):
            require_units(wrong, mass_kg if known else None)


@given(mass_kg=st.floats(20, 150), power=st.sampled_from([-3, -2]), fault=st.integers(0, 3))
def test_faults_of_forces_at_centres_of_pressure_name_columns_or_a_unit_that_mends_them(
    mass_kg, power, fault
):
    sound = steps(mass_kg, np.zeros(3), units="N,Nm,m")
    unit = {-3: "mm", -2: "cm"}[power]
    plates = list(sound.plates)
    for k, plate in enumerate(sound.plates[: 1 if fault == 3 else 2]):
        wrench = plate.wrench_in_plate.copy()
        if fault == 0:  # free torques, the centres of pressure right
            wrench[:, 5] += 10.0**-power * 0.01 * wrench[:, 2] * (4.0 if power == -3 else 1.0)
        elif fault == 1:  # forces tenfold, and moments with them
            wrench *= 10.0
        else:  # centres of pressure, of both plates or of one
            wrench[:, 3:] *= 10.0**-power
        plates[k] = replace(plate, wrench_in_plate=wrench)
    expected = [
        rf"free torques .*give --plate-units N,N{unit},m,",
        r"plate 1, 2: forces 10 times too large.* correct these channels or columns",
        rf"plate 1, 2: centres of pressure .*give --plate-units N,Nm,{unit},",
        r"plate 1: centres of pressure .* correct these channels or columns",
    ][fault]
    with pytest.raises(ValueError, match=expected) as error:
        require_units(replace(sound, plates=tuple(plates)), mass_kg)
    assert "mend_plates" not in str(error.value)


def test_an_empty_or_drifting_plate_is_not_judged():
    sound = steps(70.0, np.zeros(3))
    noise = np.random.default_rng(5).normal(size=(len(TIME), 6))
    for wrench in (0 * noise, 0.1 * noise, noise + 5.0):
        empty = replace(sound.plates[1], wrench_in_plate=wrench)
        require_units(replace(sound, plates=(sound.plates[0], empty)), 70.0)


@pytest.mark.parametrize("mending", ["2: reverse all", "2: reverse Fz"])
def test_a_plate_that_pulls_the_subject_down_is_a_doubt_with_the_mending_that_helps(mending):
    sound = steps(70.0, np.array([0.0, 0.0, -0.04]))
    assert reversed_plates(sound) == {}
    pulling = with_mended_plates(replace(sound, options=ReadOptions(mend_plates=(mending,))))
    (doubt,) = reversed_plates(pulling).values()
    assert (doubt.kind, doubt.of) == ("in_doubt", "plate 2")
    assert f'mend_plates = ["{mending}"]' in doubt.reason
    with pytest.raises(ValueError, match="mass missing") as error, saying_what_was_read(pulling):
        raise ValueError("mass missing")
    assert error.value.__notes__ == [f"on reading, {doubt}"]
