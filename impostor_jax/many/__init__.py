"""Many images or clouds: what stands for them, the work on each, and one table of all.

`map_images` is the whole of it; the commands `find` and `fit` are made of it where they
are given several.
"""
