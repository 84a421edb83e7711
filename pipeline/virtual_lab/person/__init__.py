"""The virtual person: body, walk and the ground's forces."""
