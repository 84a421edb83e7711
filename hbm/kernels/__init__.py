"""The skeleton in symbols, and the compiled functions made from it."""
