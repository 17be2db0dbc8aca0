"""How well are cylinders found without masks, beside other programs?"""
