"""Fitting a cylinder to a depth image."""
