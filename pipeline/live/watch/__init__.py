"""Gait cycles, residuals so far, and what a laboratory should know before the subject has gone."""
