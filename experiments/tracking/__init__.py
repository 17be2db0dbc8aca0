"""How well cylinders are followed through videos."""
