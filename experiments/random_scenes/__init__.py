"""How often is a fit of a random scene wrong, and does it say so?"""
