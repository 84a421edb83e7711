"""The laboratory's instruments: what they make of what really happens."""
