"""Does the last bit of a depth decide what a fit says?"""
