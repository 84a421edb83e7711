"""Experiment 1: force plates against known weights."""
