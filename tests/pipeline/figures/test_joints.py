"""Bands of healthy adults lie behind joint angles and moments where they can be compared."""

import numpy as np
import pytest

import pipeline
from pipeline.figures.joints import LEG, healthy_bands, joint_figure, trial_figure
from pipeline.figures.style import COLOURS, drawing
from pipeline.trial.gait.cycles import mean_and_sd
from pipeline.trial.joints import CURVES, JOINT_MOTIONS, joint_curves
from pipeline.virtual_lab.protocol.walking_trial import simulate_trial
from tests.virtual_gait.fit_gait import evaluate, fourier
from tests.virtual_gait.fit_healthy import read_bands


def distances(result):
    """Distance of the mean from that of healthy adults, in their SD, (101,), and both means."""
    of_sides = joint_curves(result)["measured"]
    mean, _ = mean_and_sd(np.concatenate([*of_sides.values()]))
    names = [motion.name for motion in JOINT_MOTIONS]
    for (motion, curve), (usual, sd) in healthy_bands().items():
        own = mean[:, names.index(motion), [*CURVES].index(curve)]
        yield motion, curve, np.abs(own - usual) / sd, np.corrcoef(own, usual)[0, 1]


def test_a_simulated_walk_is_within_two_sd_of_healthy_adults(tmp_path):
    """Angles are fitted to them; moments follow from feet, body and ground, not from the norms."""
    simulate_trial(tmp_path / "walk.c3d", duration_s=20.0)
    walk = pipeline.read_c3d(tmp_path / "walk.c3d")
    subject = pipeline.Subject(sex="male", mass_kg=74.6)
    result = pipeline.process_recording(walk, subject, pipeline.Settings())
    found = [*distances(result)]
    for motion, curve, distance, correlation in found:
        assert correlation > 0.7, (motion, curve)
        if curve == "angle":
            assert np.mean(distance < 2) >= 0.9, motion
    assert np.mean([distance < 2 for _, _, distance, _ in found]) >= 0.9


def test_a_real_walk_is_within_two_sd_of_healthy_adults_in_stance(shared_data):
    path = shared_data / "treadmill_hbm2" / "treadmill_events.c3d"
    result = pipeline.process_recording(
        pipeline.read_c3d(path), pipeline.Subject(), pipeline.Settings()
    )
    for motion, curve, distance, correlation in distances(result):
        assert np.mean(distance[:60] < 2) >= 0.9, (motion, curve)
        assert correlation > 0.8, (motion, curve)


def test_the_bands_are_those_of_the_published_norms(shared_data):
    published = read_bands(shared_data / "normative_gait" / "pinzone_2014.csv")
    assert {*published} == {*healthy_bands()}
    for key, band in healthy_bands().items():
        for ours, theirs in zip(band, published[key], strict=True):
            fitted = evaluate(fourier(theirs), np.arange(50) / 50)
            np.testing.assert_allclose(ours[:-1:2], fitted, atol=1e-3)
            error = np.sqrt(np.mean((ours[:-1:2] - theirs) ** 2))
            assert error < published[key][1].mean() / 3, key


def test_the_band_is_drawn_one_sd_to_both_sides_where_there_is_one():
    flat = np.zeros((101, len(JOINT_MOTIONS), len(CURVES)))
    figure = joint_figure([("measured", "red", "-", flat, flat)], "", healthy=healthy_bands())
    with_bands = set()
    for panel, (row, motion) in zip(
        figure.axes, [(row, motion) for row in CURVES for motion in LEG], strict=True
    ):
        bands = [drawn for drawn in panel.collections if drawn.get_label() == "healthy ± SD"]
        if bands:
            usual, sd = healthy_bands()[motion.name, row]
            heights = bands[0].get_paths()[0].vertices[:, 1]
            assert heights.max() == pytest.approx((usual + sd).max())
            with_bands.add((motion.name, row))
    assert with_bands == {*healthy_bands()}


def test_a_trial_is_drawn_alike_whichever_was_drawn_before():
    first, second = np.random.default_rng(0).normal(size=(2, 2, 101, len(JOINT_MOTIONS), 3))
    second[1, :20] = np.nan
    alone = drawing(trial_figure({"measured": second}))
    assert drawing(trial_figure({"measured": 100 * first})) != alone
    assert drawing(trial_figure({"measured": second})) == alone
    title = "Joints of the legs, mean ± SD"
    curves = [("measured", COLOURS["measured"], "-", *second)]
    assert drawing(joint_figure(curves, title, healthy=healthy_bands())) == alone
