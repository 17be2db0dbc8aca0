"""How exact is the cylinder at the extremes, beside other formulas?"""
