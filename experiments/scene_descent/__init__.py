"""How often do gradients recover a scene, with outlines that count and without?"""
