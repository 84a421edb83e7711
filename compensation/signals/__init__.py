"""Commanded motion of the treadmill: the calibration and validation signals."""
