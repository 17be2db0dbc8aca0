"""What does the package say of images and clouds that an earlier version has seen?"""
