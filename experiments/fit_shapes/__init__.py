"""Do fits of spheres and frusta reach the bound, and is a taper told from none?"""
