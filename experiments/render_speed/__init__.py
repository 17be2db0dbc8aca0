"""Time of a render and of its gradient, beside C and other programs."""
