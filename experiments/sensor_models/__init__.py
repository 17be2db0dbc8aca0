"""How far off is a fit whose mask is not the object's?"""
