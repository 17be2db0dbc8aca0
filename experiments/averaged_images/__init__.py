"""Fits to depth images that were made smaller, enlarged or smoothed."""
