"""Exact answers, in 50 digits, from formulas that the package does not use."""
