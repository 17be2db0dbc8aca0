"""The command line; its modules load JAX only after the arguments are parsed."""
