"""Do fits of tubes reach the bound, and is a bore told from none?"""
