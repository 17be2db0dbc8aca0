"""How far off are fits of cans whose sizes are known, in photographs of depth?"""
