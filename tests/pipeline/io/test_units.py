import numpy as np
import pytest

from pipeline.io.units import check_span, force_in_n, length_in_m, moment_in_nm, speed_in_mps


@pytest.mark.parametrize(
    ("unit", "metre"),
    [("mm", 1e-3), ("MM", 1e-3), ("cm", 1e-2), ("m", 1), ("meters", 1), ("millimetre", 1e-3)],
)
def test_lengths(unit, metre):
    assert length_in_m(unit) == metre


@pytest.mark.parametrize(("unit", "newton"), [("N", 1), ("nt", 1), ("Newtons", 1), ("kN", 1e3)])
def test_forces(unit, newton):
    assert force_in_n(unit) == newton


@pytest.mark.parametrize(
    ("unit", "newton_metre"),
    [
        ("Nmm", 1e-3),
        ("ntmm", 1e-3),
        ("N.mm", 1e-3),
        ("N*mm", 1e-3),
        ("N·mm", 1e-3),
        ("N-mm", 1e-3),
        ("N mm", 1e-3),
        ("Nm", 1),
        ("Newton-meters", 1),
        ("Ncm", 1e-2),
        ("kNm", 1e3),
    ],
)
def test_moments(unit, newton_metre):
    assert moment_in_nm(unit) == newton_metre


@pytest.mark.parametrize(
    ("unit", "metre_per_second"),
    [
        ("m/s", 1),
        ("M/S", 1),
        (" m / s ", 1),
        ("m/sec", 1),
        ("metres/second", 1),
        ("cm/s", 1e-2),
        ("mm/s", 1e-3),
        ("km/h", 1 / 3.6),
        ("kph", 1 / 3.6),
        ("mph", 0.44704),
    ],
)
def test_speeds(unit, metre_per_second):
    assert speed_in_mps(unit) == metre_per_second


@pytest.mark.parametrize("unit", ["", "m", "Nm/s", "rpm/s", "m/s²", "m/s/s", "m/s2", "deg/s"])
def test_units_of_something_else_are_no_units_of_speed(unit):
    with pytest.raises(ValueError, match="speed unit"):
        speed_in_mps(unit)


@pytest.mark.parametrize("convert", [length_in_m, force_in_n, moment_in_nm])
@pytest.mark.parametrize("unit", ["", "  ", "V", "lb", "in", "mmm", "deg"])
def test_unknown_units_are_refused_with_what_is_expected(convert, unit):
    with pytest.raises(ValueError, match=r"unit.*expected"):
        convert(unit)


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_markers_of_a_person_span_neither_millimetres_nor_kilometres(subject, scale):
    check_span(subject.position, "m", stated=False)
    with pytest.raises(ValueError, match="correct the unit in the file, or state it: --units mm"):
        check_span(subject.position * scale, "mm", stated=False)
    with pytest.raises(ValueError, match=r"m; correct --units, or units in study\.toml$"):
        check_span(subject.position * scale, "mm", stated=True)


def test_a_single_marker_or_none_has_no_span_to_judge():
    check_span(np.ones((5, 1, 3)), "mm", stated=False)
    check_span(np.full((5, 3, 3), np.nan), "mm", stated=False)
    check_span(np.empty((5, 0, 3)), "mm", stated=False)
