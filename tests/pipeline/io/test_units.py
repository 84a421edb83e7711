"""Units are known in every spelling, and unknown ones are refused with what is expected."""

import pytest

from pipeline.io.units import force_in_n, length_in_m, moment_in_nm, speed_in_mps

UNITS = {
    length_in_m: {"mm MM millimetre": 1e-3, "cm": 1e-2, "m meters": 1},
    force_in_n: {"N nt Newtons": 1, "kN": 1e3},
    moment_in_nm: {"Nmm ntmm N.mm N*mm N·mm N-mm": 1e-3, "Nm Newton-meters": 1, "kNm": 1e3},
    speed_in_mps: {"m/s M/S m/sec metres/second": 1, "mm/s": 1e-3, "km/h kph": 1 / 3.6},
}


@pytest.mark.parametrize("convert", UNITS)
def test_units_of_every_spelling_are_known(convert):
    for spellings, size in UNITS[convert].items():
        for unit in (*spellings.split(), f" {spellings.split()[0]} "):
            assert convert(unit) == size
    assert moment_in_nm("N mm") == 1e-3


@pytest.mark.parametrize("convert", [length_in_m, force_in_n, moment_in_nm])
@pytest.mark.parametrize("unit", ["", "V", "mmm"])
def test_unknown_units_are_refused_with_what_is_expected(convert, unit):
    with pytest.raises(ValueError, match=r"unit.*expected"):
        convert(unit)
