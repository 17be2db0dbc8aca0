"""What a graphics card gains, and where it does not."""
