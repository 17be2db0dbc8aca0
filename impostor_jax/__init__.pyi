from . import io
from .calibrate.calibration import calibrate_sensor
from .camera.base import AbstractCamera
from .camera.opengl import NearFar, near_far_of
from .camera.orthographic import OrthographicCamera
from .camera.pinhole import PinholeCamera
from .camera.pixels import Tile
from .camera.ray_table import depth_of_ranges
from .camera.spherical import SphericalCamera
from .effort import Effort
from .find.cylinders import find_cylinders
from .find.found import Found, FoundInPoints
from .fit.alternatives import Alternatives
from .fit.bore import BoreTest, test_bore
from .fit.budget import Deviations
from .fit.depth_loss import depth_loss
from .fit.form import Form
from .fit.result import (
    Directions,
    Fit,
    FitResult,
    FrustumDeviations,
    FrustumFit,
    OutlineGap,
    SphereDeviations,
    SphereFit,
)
from .fit.status import FitStatus
from .fit.taper import TaperTest, test_taper
from .fits.batch import fit_cylinders
from .fits.labels import fit_labels
from .fits.points import fit_cylinder_to_points
from .fits.search_points import find_cylinders_in_points
from .fits.single import fit_box, fit_cylinder, fit_frustum, fit_sphere, fit_tube
from .geometry.frames import RigidTransform
from .io.camera_from import camera_from
from .io.dataset import read_dataset
from .io.dataset_shard import LabeledImage
from .io.depth_folder import DepthFolder, DepthFrame, read_depth_folder
from .io.found_table import write_table
from .io.mesh_export import to_mesh
from .io.mesh_file import read_mesh
from .io.point_cloud import PointCloud
from .io.points_file import read_points
from .many.mapping import map_images
from .many.results import read_results
from .page.fit_page import FitPage, view
from .primitives.base import AbstractPrimitive
from .primitives.box import Box
from .primitives.cylinder import Cylinder
from .primitives.frustum import Frustum
from .primitives.heightfield import Heightfield
from .primitives.plane import Plane
from .primitives.solid import Solid, difference, intersection, union
from .primitives.sphere import Sphere
from .primitives.terrain import Terrain
from .primitives.torus import Torus
from .primitives.triangle import Triangle
from .primitives.tube import Tube, tube
from .rendering.coverage import coverage
from .rendering.distance import signed_distance
from .rendering.lights import AmbientLight, DirectionalLight, PointLight
from .rendering.maps import GeometryMaps
from .rendering.material import Material
from .rendering.outline_curve import Outline, outline
from .rendering.render import render
from .rendering.scene import Scene
from .rendering.shade import shade
from .rendering.shadow import lit
from .rendering.silhouettes import Silhouettes, silhouettes
from .rendering.sphere_outline import SphereOutline
from .rendering.tile import outline_box, outline_tile
from .rendering.trace import trace
from .sensor.aligned import AlignedDepth
from .sensor.base import AbstractDepthNoise
from .sensor.correlated import CorrelatedNoise, LineNoise
from .sensor.dropout import Dropout
from .sensor.flying_pixels import FlyingPixels
from .sensor.gaussian import ConstantNoise
from .sensor.lateral import LateralNoise
from .sensor.matching_window import MatchingWindow
from .sensor.quantization import StereoDisparity
from .sensor.scale_error import ScaleError
from .sensor.structured_light import StructuredLight
from .sensor.time_of_flight import TimeOfFlight
from .track.track import Track, TrackStatus
from .track.tracker import Tracker

__version__: str

__all__ = [
    "AbstractCamera",
    "AbstractDepthNoise",
    "AbstractPrimitive",
    "AlignedDepth",
    "Alternatives",
    "AmbientLight",
    "BoreTest",
    "Box",
    "ConstantNoise",
    "CorrelatedNoise",
    "Cylinder",
    "DepthFolder",
    "DepthFrame",
    "Deviations",
    "DirectionalLight",
    "Directions",
    "Dropout",
    "Effort",
    "Fit",
    "FitPage",
    "FitResult",
    "FitStatus",
    "FlyingPixels",
    "Form",
    "Found",
    "FoundInPoints",
    "Frustum",
    "FrustumDeviations",
    "FrustumFit",
    "GeometryMaps",
    "Heightfield",
    "LabeledImage",
    "LateralNoise",
    "LineNoise",
    "MatchingWindow",
    "Material",
    "NearFar",
    "OrthographicCamera",
    "Outline",
    "OutlineGap",
    "PinholeCamera",
    "Plane",
    "PointCloud",
    "PointLight",
    "RigidTransform",
    "ScaleError",
    "Scene",
    "Silhouettes",
    "Solid",
    "Sphere",
    "SphereDeviations",
    "SphereFit",
    "SphereOutline",
    "SphericalCamera",
    "StereoDisparity",
    "StructuredLight",
    "TaperTest",
    "Terrain",
    "Tile",
    "TimeOfFlight",
    "Torus",
    "Track",
    "TrackStatus",
    "Tracker",
    "Triangle",
    "Tube",
    "calibrate_sensor",
    "camera_from",
    "coverage",
    "depth_loss",
    "depth_of_ranges",
    "difference",
    "find_cylinders",
    "find_cylinders_in_points",
    "fit_box",
    "fit_cylinder",
    "fit_cylinder_to_points",
    "fit_cylinders",
    "fit_frustum",
    "fit_labels",
    "fit_sphere",
    "fit_tube",
    "intersection",
    "io",
    "lit",
    "map_images",
    "near_far_of",
    "outline",
    "outline_box",
    "outline_tile",
    "read_dataset",
    "read_depth_folder",
    "read_mesh",
    "read_points",
    "read_results",
    "render",
    "shade",
    "signed_distance",
    "silhouettes",
    "test_bore",
    "test_taper",
    "to_mesh",
    "trace",
    "tube",
    "union",
    "view",
    "write_table",
]
