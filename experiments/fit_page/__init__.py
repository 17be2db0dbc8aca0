"""How large is the page of a fit, and how fast does it draw without a graphics card?"""
