"""What does the package draw, differentiate and fit?"""
