"""Vectors, rays, frames and rotations."""
