"""A trial in the Rerun viewer."""
