"""The virtual person: body, gait and ground reaction."""
