"""Measured answers to questions about impostor_jax, one folder per question."""
