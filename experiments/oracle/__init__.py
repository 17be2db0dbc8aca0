"""Exact answers, from formulas that the package does not use.

In 50 digits, but for `whitted`, which traces pictures in double precision.

They stand here, since tests may import from experiments and not the other way round,
and the package itself must not need mpmath.
"""
