"""Files. Units stand in the names of their fields and end at this boundary."""
