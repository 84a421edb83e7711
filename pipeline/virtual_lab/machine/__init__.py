"""The moving treadmill: its mechanics and its instruments."""
