"""Models of the noise of depth sensors."""
