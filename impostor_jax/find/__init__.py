"""Every cylinder in a depth image, without a mask."""
