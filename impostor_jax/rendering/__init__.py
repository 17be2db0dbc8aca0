"""Depth, normal and mask images of primitives."""
