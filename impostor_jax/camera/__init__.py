"""Cameras: which ray each pixel sees, and which pixel a point falls on."""
