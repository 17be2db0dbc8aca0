"""Exact answers, in 50 digits, from formulas that the package does not use.

They stand here, since tests may import from experiments and not the other way round,
and the package itself must not need mpmath.
"""
