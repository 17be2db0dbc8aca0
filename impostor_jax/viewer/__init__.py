"""Pictures of maps and fits."""
