"""What accelerating belts leave in their plates: the pitch moment of motor and rollers."""
