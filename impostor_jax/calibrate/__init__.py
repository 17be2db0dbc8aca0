"""Noise models from images of what is known: planes, and an object of known size."""
