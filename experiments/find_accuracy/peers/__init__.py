"""Other programs that find cylinders, and what each needs."""
