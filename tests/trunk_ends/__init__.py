"""Which end points de Leva's upper trunk has: choices compared on real recordings."""
