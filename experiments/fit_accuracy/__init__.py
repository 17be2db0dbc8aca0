"""How accurate is a fit, beside the statistical bound and beside other programs?"""
