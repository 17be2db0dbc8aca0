from .camera_from import camera_from
from .dataset import read_dataset
from .dataset_shard import LabeledImage
from .depth_folder import DepthFolder, DepthFrame, read_depth_folder
from .mesh_export import to_mesh
from .mesh_file import read_mesh
from .point_cloud import PointCloud
from .points_file import read_points

__all__ = [
    "DepthFolder",
    "DepthFrame",
    "LabeledImage",
    "PointCloud",
    "camera_from",
    "read_dataset",
    "read_depth_folder",
    "read_mesh",
    "read_points",
    "to_mesh",
]
