"""Differentiable impostor rendering."""
