"""Are datasets made fast and to the bit, and do their fits say how far off they are?"""
