"""Formats of meshes that are written, told by the ending of a file."""

__all__ = ["FORMATS", "check_mesh_file"]

from pathlib import Path

FORMATS = ("glb", "obj", "ply", "stl")
"""Of files that are written, by their endings."""


def check_mesh_file(path: Path, name: str = "output") -> None:
    """Raise a `ValueError` unless a file's ending is that of a format."""
    if path.suffix.lower().lstrip(".") not in FORMATS:
        endings = ", ".join(f".{ending}" for ending in FORMATS)
        raise ValueError(f"{name} must end in one of {endings}, got {str(path)!r}")
