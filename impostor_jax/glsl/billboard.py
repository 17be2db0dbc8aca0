"""The published billboard of a sphere, as the shader draws it on request."""

__all__ = ["near_pole_square"]

import math


def near_pole_square(radius: float, distance: float) -> tuple[float, float]:
    """Square that stands in for a sphere, across the line from camera to center.

    It goes through the sphere's near pole, and the cone of the camera's tangents to the
    sphere touches its four sides. Ours (`shaders/sphere.vert`) holds the same cone, but
    lies in the image, where the outline is an ellipse.

    Args:
        radius: R, in meters.
        distance: D of the camera from the center, in meters; more than the radius.

    Returns:
        The square's distance D - R from the camera, and half its side
        R (D - R) / L with the length L = sqrt(D^2 - R^2) of the tangents, in meters.

    Raises:
        ValueError: The camera is not outside the sphere.
    """
    if not 0 < radius < distance:
        raise ValueError(
            f"distance must be more than a positive radius, got {distance} and "
            f"{radius}; both are in meters"
        )
    tangent = math.sqrt((distance - radius) * (distance + radius))
    return distance - radius, radius * (distance - radius) / tangent
