"""Do cylinders keep their identity in a video, and do the intervals hold?"""
