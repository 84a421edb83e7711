"""A processed trial in the Rerun viewer."""
