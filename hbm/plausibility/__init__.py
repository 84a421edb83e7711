"""Checks of a body, a trial's markers and its motion against what people and cameras can do."""
