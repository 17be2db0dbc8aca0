"""Fits of shapes to depth images."""
