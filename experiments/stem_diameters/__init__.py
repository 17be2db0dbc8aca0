"""How exactly is the diameter of a tree stem known from a laser scan?"""
