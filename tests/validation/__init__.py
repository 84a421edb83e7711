"""Studies of our own and laboratory notebooks; docs/validation.md has their numbers."""
