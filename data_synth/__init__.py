"""Synthetic depth datasets of cylinders, labeled and reproducible to the bit."""
