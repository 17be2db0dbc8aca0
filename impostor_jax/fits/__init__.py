"""The fits that users call: of one image, of many images, of a label image."""
