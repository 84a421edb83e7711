"""Signals: low-pass, resampling, gaps."""
