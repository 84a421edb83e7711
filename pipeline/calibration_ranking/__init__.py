"""Experiment 2: which calibration trial is the best."""
