"""The ground: plates as measured and compensated, in the lab, at the markers' times."""
