"""Whether JAX and the drivers draw the same, on scenes where users and formulas go."""
