"""Cylinders in point clouds: what is proposed and what speaks for it."""
