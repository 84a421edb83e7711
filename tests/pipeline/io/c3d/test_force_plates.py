"""Plates of every type give the wrench that acts on them, and what cannot be read is named."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hbm.notes import Note
from pipeline.io.c3d.read import read_c3d
from pipeline.io.read_options import ReadOptions

ezc3d = pytest.importorskip("ezc3d", reason="ezc3d has no wheel for this system")

N_SAMPLES = 40
CORNERS = np.array([[464.0, 3, 1], [0, 0, 0], [-2, 508, 0], [462, 509, 2]])
CORNERS_Y_UP = np.array([[-11.0, 2, 1], [589, 0.5, 5], [586, -1, 405], [-14, 1, 401]])
FORCE_UNITS = ["N"] * 3 + ["Nmm"] * 3
AXES = "forward,left,up"  # the file's axes are the lab's


@pytest.fixture
def plate_file(raw_c3d):
    """Write a file with plates of one type and random channels."""

    def write(kind, *, origin, corners=CORNERS, units=FORCE_UNITS, n_channels=6, **extra):
        rng = np.random.default_rng(kind)
        origin, corners = np.atleast_2d(origin), np.reshape(corners, (-1, 4, 3))
        n_plates = len(corners)
        channels = n_channels * n_plates
        analog = rng.normal(200, 50, size=(N_SAMPLES // 4, 4, channels))
        points = np.tile(np.arange(1.0, 5), (N_SAMPLES // 4, 1, 1))
        return raw_c3d(
            points,
            analog,
            POINT={"LABELS": ["MARKER"]},
            ANALOG={"UNITS": units * n_plates},
            FORCE_PLATFORM={
                "USED": np.array([n_plates]),
                "TYPE": np.full(n_plates, kind),
                "ZERO": np.array([1, 0]),
                "CORNERS": corners.T.astype(float),
                "ORIGIN": origin.T.astype(float),
                "CHANNEL": np.arange(1, channels + 1).reshape(n_plates, -1).T,
                **extra,
            },
        )

    return write


def ezc3d_plates(path):
    return ezc3d.c3d(str(path), extract_forceplat_data=True)["data"]["platform"]


def about_centre_in_file_axes(plate):
    """Give force [N] and moment [N·m] about the surface's centre, in the file's axes."""
    force = plate.wrench_in_plate[:, :3] @ plate.rotation.T
    return force, plate.wrench_in_plate[:, 3:] @ plate.rotation.T


def assert_equals_ezc3d(path, moment_sign=1):
    recording = read_c3d(path, AXES)
    expected = ezc3d_plates(path)
    assert len(recording.plates) == len(expected) > 0
    for plate, oracle in zip(recording.plates, expected, strict=True):
        force, moment = about_centre_in_file_axes(plate)
        scale = {"mm": 1e-3, "m": 1.0}[oracle["unit_position"]]
        np.testing.assert_allclose(force, oracle["force"].T, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(
            moment, moment_sign * scale * oracle["moment"].T, rtol=1e-9, atol=1e-7
        )
        np.testing.assert_allclose(plate.corners, scale * oracle["corners"].T, atol=1e-12)


@pytest.mark.parametrize("corners", [CORNERS_Y_UP, [CORNERS, CORNERS + 600]])
@pytest.mark.parametrize("origin", [[1.5, -0.7, -37.5], [-1.5, 0.7, 37.5]])
def test_type_2_wrenches_equal_ezc3d(plate_file, corners, origin):
    n_plates = len(np.reshape(corners, (-1, 4, 3)))
    assert_equals_ezc3d(plate_file(2, origin=[origin] * n_plates, corners=corners))


def test_type_4_with_cross_talk_equals_ezc3d(plate_file):
    rng = np.random.default_rng(4)
    calibration = np.diag([1.5, 1.5, 6, 700, 700, 350]) + rng.normal(0, 0.1, (2, 6, 6))
    path = plate_file(
        4,
        origin=[[1, 2, -40]] * 2,
        corners=[CORNERS, CORNERS + 600],
        units=["V"] * 6,
        CAL_MATRIX=calibration.transpose(2, 1, 0),
    )
    assert_equals_ezc3d(path)


def test_type_3_wrenches_equal_ezc3d(plate_file):
    path = plate_file(3, origin=[120, 200, -54], units=["N"] * 8, n_channels=8)
    assert_equals_ezc3d(path)


def test_type_1_equals_ezc3d_but_for_the_sign_of_its_moment(plate_file):
    """ezc3d's own TYPE 1 moment contradicts its free moment: M − CoP × F gives −Tz there."""
    path = plate_file(
        1, origin=[0, 0, 0], corners=CORNERS_Y_UP, units=["N"] * 3 + ["mm"] * 2 + ["Nmm"]
    )
    assert_equals_ezc3d(path, moment_sign=-1)
    (oracle,) = ezc3d_plates(path)
    arm = oracle["center_of_pressure"].T - oracle["corners"].mean(axis=1)
    (plate,) = read_c3d(path, AXES).plates
    _, moment = about_centre_in_file_axes(plate)
    free = moment * 1e3 - np.cross(arm, oracle["force"].T)
    np.testing.assert_allclose(free, oracle["Tz"].T, atol=1e-6 * np.abs(oracle["moment"]).max())


def test_a_known_force_at_a_known_point_gives_its_wrench(plate_file, raw_c3d):
    """The transducer lies 40 mm below a surface centred at (0.5, 0.2, 0) m; z points down."""
    corners = np.array([[900.0, -50, 0], [100, -50, 0], [100, 450, 0], [900, 450, 0]])
    force, point, twist = np.array([20.0, -30, 700]), np.array([0.6, 0.1, 0]), 5.0
    to_plate = np.diag([1.0, -1.0, -1.0])
    arm = point - np.array([0.5, 0.2, -0.04])
    moment = np.cross(arm, force) + np.array([0, 0, twist])
    channels = np.hstack([to_plate @ force, to_plate @ moment * 1e3])
    path = raw_c3d(
        np.ones((5, 1, 4)),
        np.tile(channels, (5, 2, 1)),
        POINT={"LABELS": ["MARKER"]},
        ANALOG={"UNITS": FORCE_UNITS},
        FORCE_PLATFORM={
            "USED": np.array([1]),
            "TYPE": np.array([2]),
            "CORNERS": corners.T[..., None],
            "ORIGIN": np.array([[0.0], [0], [-40]]),
            "CHANNEL": np.arange(1, 7)[:, None],
        },
    )
    (plate,) = read_c3d(path, AXES).plates
    expected = np.hstack([force, np.cross(point, force) + np.array([0, 0, twist])])
    np.testing.assert_allclose(plate.wrench, np.tile(expected, (10, 1)), rtol=1e-6)


def reasons(recording):
    """Why plates are left out, by plate."""
    return {fact.of: fact.reason for fact in recording.facts if fact.kind == "left_out"}


@pytest.mark.parametrize("corner", [0, 3])
def test_a_corner_beside_the_rectangle_of_the_other_three_is_a_warning(plate_file, corner):
    def notes(moved_mm):
        corners = np.array([[464.0, 0, 0], [0, 0, 0], [0, 508, 0], [464, 508, 0]])
        corners[corner, 0] += moved_mm
        read = read_c3d(plate_file(2, origin=[0, 0, -40], corners=corners), AXES)
        return [note for note in read.notes if note.code == "in_doubt"]

    assert notes(4.0) == []
    (note,) = notes(30.0)
    assert "30 mm" in note.text
    assert note.level == "warning"


@given(
    width=st.floats(400, 800),
    length=st.floats(450, 1800),
    written=st.sampled_from(["m", "cm", "mm"]),
    unit=st.sampled_from(["m", "cm", "mm"]),
    depth=st.floats(10, 200),
)
@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_corners_in_another_unit_make_the_same_plate(raw_c3d, width, length, written, unit, depth):
    """What the markers' unit makes of them is no plate under the markers on it; a Fact says so."""
    corners = np.array([[width, 0, 0], [0, 0, 0], [0, length, 0], [width, length, 0]])
    mm = {"m": 1e-3, "cm": 0.1, "mm": 1.0}
    point = np.append(np.array([width / 2, length / 2, 40]) * mm[unit], 0)
    path = raw_c3d(
        np.tile(point, (20, 1, 1)),
        np.ones((20, 4, 6)),
        POINT={"LABELS": ["MARKER"], "UNITS": unit},
        ANALOG={"UNITS": FORCE_UNITS},
        FORCE_PLATFORM={
            "USED": np.array([1]),
            "TYPE": np.array([2]),
            "CORNERS": (corners * mm[written]).T[..., None],
            "ORIGIN": (np.array([[0.0, 0, -depth]]) * mm[unit]).T,
            "CHANNEL": np.arange(1, 7)[:, None],
        },
    )
    recording = read_c3d(path, AXES)
    np.testing.assert_allclose(recording.plates[0].corners, corners / 1000, rtol=1e-5)
    np.testing.assert_allclose(recording.plates[0].transducer, [0, 0, depth / 1000], rtol=1e-4)
    corrected = [fact.of for fact in recording.facts if fact.kind == "corrected"]
    assert [what.split()[0::2] for what in corrected] == [["corners", "plate"]] * (written != unit)


def test_corners_that_are_a_plate_in_no_unit_leave_the_plate_out(plate_file):
    corners = [[18.2, 0, 0], [0, 0, 0], [0, 20, 0], [18.2, 20, 0]]
    recording = read_c3d(plate_file(2, origin=[0, 0, -40], corners=corners), AXES)
    (fact,) = recording.facts
    assert (recording.plates, fact.kind) == ((), "left_out")
    assert "18.2 × 20 mm" in fact.reason


@pytest.mark.parametrize("edge_mm", [60.0, 120.0])
def test_a_small_sensor_beside_the_walkway_keeps_its_size(plate_file, edge_mm):
    corners = edge_mm * np.array([[1.0, 0, 9], [0, 0, 9], [0, 1, 9], [1, 1, 9]])
    recording = read_c3d(plate_file(2, origin=[0, 0, -8], corners=corners), AXES)
    np.testing.assert_allclose(recording.plates[0].corners, corners / 1000, rtol=1e-5)
    assert recording.facts == ()


@pytest.mark.parametrize("used", [0, 1])
def test_a_plate_that_is_described_but_not_counted_is_named(plate_file, used):
    path = plate_file(
        2,
        origin=[[0, 0, -20], [0, 0, -20]],
        corners=[CORNERS, CORNERS + np.array([0, 600, 0])],
        USED=np.array([used]),
    )
    recording = read_c3d(path, AXES)
    left_out = [fact.of for fact in recording.facts if fact.kind == "left_out"]
    assert left_out == ["plate 1", "plate 2"][used:]


def test_an_empty_plate_stays_finite_and_missing_samples_stay_missing(plate_file):
    path = plate_file(2, origin=[0, 0, -40])
    content = bytearray(path.read_bytes())
    content[-24 * 4 :] = np.zeros(24, "<f4").tobytes()
    content[-52 * 4 : -28 * 4] = np.full(24, np.nan, "<f4").tobytes()
    path.write_bytes(content)
    (plate,) = read_c3d(path, AXES).plates
    assert (plate.wrench[-4:] == 0).all()
    assert np.isnan(plate.wrench[-8:-4]).all()
    assert np.isfinite(plate.wrench[:-8]).all()


@pytest.mark.parametrize(
    ("kind", "written", "stated", "units"),
    [
        (2, ["V"] * 6, "N,Nmm", ["N"] * 3 + ["Nmm"] * 3),
        (2, [""] * 6, "kN,Nm", ["kN"] * 3 + ["Nm"] * 3),
        (2, ["N"] * 3 + ["Nm"] * 3, "N,Nmm", ["N"] * 3 + ["Nmm"] * 3),
        (1, [*"NNN", "mm", "mm", "V"], "N,Nm,cm", [*"NNN", "cm", "cm", "Nm"]),
        (4, ["V"] * 6, "N,Nm", ["N"] * 3 + ["Nm"] * 3),
    ],
)
def test_plates_in_stated_units_are_those_of_a_file_that_says_them(
    plate_file, kind, written, stated, units
):
    """A centre of pressure keeps the file's unit, or takes the moment's if the file's is none."""
    extra = {"CAL_MATRIX": np.eye(6)[..., None]} if kind == 4 else {}
    origin = [0, 0, 0] if kind == 1 else [0, 0, -40]
    path = plate_file(kind, origin=origin, units=written, **extra)
    read = read_c3d(path, ReadOptions(AXES, plate_units=stated))
    said = read_c3d(plate_file(kind, origin=origin, units=units, **extra), AXES)
    np.testing.assert_array_equal(read.plates[0].wrench, said.plates[0].wrench)


def test_the_refusal_of_a_plates_unit_names_the_option_that_states_it(plate_file):
    path = plate_file(2, origin=[0, 0, -40], units=["lbf"] * 3 + ["Nmm"] * 3)
    with pytest.raises(ValueError, match=r'--plate-units N,Nmm, .*plate_units = "N,Nmm"'):
        read_c3d(path, AXES)


@pytest.mark.parametrize(("unit", "holds"), [("V", "volts"), ("ADC", "converter")])
def test_raw_signals_are_refused_with_what_to_ask_the_laboratory_for(plate_file, unit, holds):
    path = plate_file(2, origin=[0, 0, -40], units=[unit] * 6)
    asked = rf"{holds} \({unit}\).*calibration matrix.*--plate-units N,Nmm"
    with pytest.raises(ValueError, match=rf"plate 1: channel .*{asked}"):
        read_c3d(path, AXES)


def test_labels_and_plates_that_cannot_be_read_are_refused_at_once_labels_first(raw_c3d):
    names = [f"Own{k}" for k in range(30)]
    path = raw_c3d(
        np.random.default_rng(0).normal(0, 500, size=(20, 30, 4)),
        np.full((20, 4, 6), 200.0),
        POINT={"LABELS": names},
        ANALOG={"UNITS": ["V"] * 6},
        FORCE_PLATFORM={
            "USED": np.array([1]),
            "TYPE": np.array([2]),
            "CORNERS": CORNERS.T[..., None].astype(float),
            "ORIGIN": np.array([[0.0], [0.0], [-40.0]]),
            "CHANNEL": np.arange(1, 7)[:, None],
        },
    )
    with pytest.raises(
        ValueError, match=r"^made_to_order\.c3d: .*Own0.*plate 1: .*volts"
    ) as refused:
        read_c3d(path)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("extra", "reason"),
    [
        ({"TYPE": np.array([2, 5])}, "TYPE 5"),
        ({"CORNERS": np.dstack([CORNERS.T, np.zeros((3, 4))])}, "corners"),
        ({"ORIGIN": np.array([[0, np.nan], [0, 0], [-40, -40]])}, "ORIGIN"),
        ({"CHANNEL": np.column_stack([range(1, 7), range(8, 14)])}, "12 analo"),
    ],
)
def test_a_plate_that_is_not_described_is_left_out_and_the_other_kept(plate_file, extra, reason):
    both = {"origin": [[0, 0, -40]] * 2, "corners": [CORNERS, CORNERS + 600]}
    whole = read_c3d(plate_file(2, **both), AXES)
    recording = read_c3d(plate_file(2, **both, **extra), AXES)
    np.testing.assert_array_equal(recording.plates[0].wrench, whole.plates[0].wrench)
    assert [plate.number for plate in recording.plates] == [1]
    assert reason in reasons(recording)["plate 2"]
    assert "A6" in recording.analog.names  # its channels are like any other


@pytest.mark.parametrize(
    "name",
    [
        "c3d_samples/DEC_INT.C3D",
        "c3d_samples/Gait.c3d",
        "c3d_samples/TYPE-4.C3D",
        "treadmill_hbm2/treadmill_events.c3d",
    ],
)
def test_plates_of_real_files_equal_ezc3d(shared_data, name):
    assert_equals_ezc3d(shared_data / name)


def test_the_real_treadmill_carries_the_subject_under_the_feet(shared_data):
    recording = read_c3d(shared_data / "treadmill_hbm2" / "treadmill_events.c3d")
    weight = sum(plate.wrench[:, 2].mean() for plate in recording.plates)
    assert weight == pytest.approx(548.4, abs=0.2)
    markers = recording.markers
    for plate, side in zip(recording.plates, "LR", strict=True):
        wrench = plate.wrench[::10]
        loaded = wrench[:, 2] > 300
        cop = np.column_stack([-wrench[:, 4], wrench[:, 3]])[loaded] / wrench[loaded, 2:3]
        heel, toe = (
            markers.position[loaded][:, markers.names.index(side + site), :2]
            for site in ("HEE", "MT2")
        )
        assert np.median(np.linalg.norm(cop - (heel + toe) / 2, axis=1)) < 0.1


def test_a_baseline_in_the_file_is_named_but_not_subtracted(plate_file):
    plain = read_c3d(plate_file(2, origin=[0, 0, -40]), AXES)
    zeroed = read_c3d(plate_file(2, origin=[0, 0, -40], ZERO=np.array([1, 10])), AXES)
    np.testing.assert_array_equal(plain.plates[0].wrench, zeroed.plates[0].wrench)
    assert Note.of("plate_baseline_not_subtracted", first=1, last=10) in zeroed.notes
