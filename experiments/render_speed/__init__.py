"""Time of a render, of its gradient and of a fit; the render beside C."""
