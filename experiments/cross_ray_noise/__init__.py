"""Do intervals of fits hold whose readings err across their rays?"""
