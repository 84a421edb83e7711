"""The virtual treadmill: its motion and its instruments."""
