"""Tables of numbers in, tests out."""
