"""How many images an hour, and does it matter what is killed or broken?"""
