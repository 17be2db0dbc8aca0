"""Cylinders followed through a video of depth images."""
