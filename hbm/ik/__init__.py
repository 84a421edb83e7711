"""Inverse kinematics: from starting poses to optima."""
