"""Does a fit to what is almost a cylinder know how far off it may be?"""
