"""What goes wrong with the published formulas of the cylinder impostor."""
