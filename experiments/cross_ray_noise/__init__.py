"""Errors across the ray: what they do to fits, told, learned or left out."""
