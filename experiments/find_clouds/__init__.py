"""How well cylinders are found in clouds of points."""
