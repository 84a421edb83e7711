"""Plates, cameras and accelerometers brought to one clock and one place."""
