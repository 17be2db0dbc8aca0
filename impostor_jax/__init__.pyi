from .camera.base import AbstractCamera
from .camera.pinhole import PinholeCamera
from .camera.pixels import Tile
from .fit.result import Deviations, FitResult, FitStatus
from .fit.solve import fit_cylinder
from .geometry.frames import RigidTransform
from .primitives.base import AbstractPrimitive
from .primitives.cylinder import Cylinder
from .rendering.maps import GeometryMaps
from .rendering.raycast import render
from .rendering.tile import outline_box, outline_tile
from .sensor.base import AbstractDepthNoise
from .sensor.gaussian import ConstantNoise

__all__ = [
    "AbstractCamera",
    "AbstractDepthNoise",
    "AbstractPrimitive",
    "ConstantNoise",
    "Cylinder",
    "Deviations",
    "FitResult",
    "FitStatus",
    "GeometryMaps",
    "PinholeCamera",
    "RigidTransform",
    "Tile",
    "fit_cylinder",
    "outline_box",
    "outline_tile",
    "render",
]
