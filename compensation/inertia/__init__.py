"""What sway and pitch leave in the plates: inertia and weight of the belt assemblies."""
