"""Accuracy of force plates: known weights, errors, linearity."""
