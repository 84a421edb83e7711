"""Signals: filters, resampling, gaps."""
