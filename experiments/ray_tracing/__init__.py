"""What a traced picture costs, and how far off it is."""
