"""What flags of a fit name: the noise of a sensor, a shape to begin with, hints."""

__all__ = [
    "camera_of",
    "chosen_noise",
    "files_of",
    "hints_on_stderr",
    "images_of",
    "priors_of",
    "start_of",
]

import contextlib
import glob
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from impostor_jax.many.items import AbstractItem
    from impostor_jax.primitives.base import AbstractPrimitive


def chosen_noise(
    sigma: float | None, sensor: str | None, camera: Callable[[], Any]
) -> Any:
    """What a fit takes for sigma: a number, a noise model, or None for neither.

    Args:
        sigma: Of `--sigma`; None where a sensor is given (`check_noise`).
        sensor: Of `--sensor`: a name, or a JSON file.
        camera: Gives that whose focal length a stereo camera has, unless its file says
            another.

    Raises:
        ValueError: The sensor is unknown.
    """
    if sensor is None:
        return sigma
    from impostor_jax.camera.pinhole import PinholeCamera
    from impostor_jax.io.sensor_record import read_sensor, sensor_from_record

    seen_by = camera()
    focal_length = float(seen_by.fx) if isinstance(seen_by, PinholeCamera) else None
    if sensor.endswith(".json"):
        return read_sensor(Path(sensor), focal_length)
    return sensor_from_record({"type": sensor}, f"sensor {sensor!r}", focal_length)


def camera_of(item: "AbstractItem") -> Any:
    """The camera of an image; None of one that is broken, which is said in its turn."""
    try:
        return item.read().camera
    except (ValueError, OSError):
        return None


Prior = tuple[float, float] | None
"""A value and its standard deviation, if they are given."""


def priors_of(radius: Prior, height: Prior) -> dict[str, tuple[float, float]]:
    """What a fit takes for prior, of those that are given."""
    priors = {"radius": radius, "height": height}
    return {name: prior for name, prior in priors.items() if prior}


def start_of(path: Path | None, shape: str) -> "AbstractPrimitive | None":
    """Shape that a fit begins with, from a scene file; None stays.

    Raises:
        ValueError: The file holds another shape, or several.
    """
    if path is None:
        return None
    from impostor_jax.io.scene_file import read_scene
    from impostor_jax.primitives import PRIMITIVES
    from impostor_jax.primitives.tube import is_tube

    shapes = read_scene(path).shapes
    is_one = len(shapes) == 1 and (
        is_tube(shapes[0]) if shape == "tube" else type(shapes[0]) is PRIMITIVES[shape]
    )
    if not is_one:
        found = ", ".join(type(one).__name__.lower() for one in shapes)
        raise ValueError(
            f"scene file {str(path)!r} must hold one {shape} to begin with, got {found}"
        )
    return shapes[0]


def images_of(given: Sequence[Path]) -> list[Path]:
    """Depth images, of which folders and patterns stand for several, in order.

    Raises:
        ValueError: A folder or a pattern stands for none.
    """
    from impostor_jax.io.depth_image import SUFFIXES

    images = []
    for path in given:
        is_pattern = not path.exists() and glob.has_magic(str(path))
        if not (is_pattern or path.is_dir()):
            images.append(path)
            continue
        entries = map(Path, glob.glob(str(path))) if is_pattern else path.iterdir()
        some = [one for one in entries if one.suffix.lower() in SUFFIXES]
        if not some:
            raise ValueError(f"{str(path)!r} must hold depth images, got none")
        images += sorted(some)
    return images


def files_of(flag: str, given: Sequence[Path], images: Sequence[Path]) -> list[Path]:
    """Masks or labels of depth images, in their order; [] where none are given.

    Raises:
        ValueError: There are more or fewer than images.
    """
    if len(given) == 1 and given[0].is_dir():
        return [given[0] / f"{image.stem}.png" for image in images]
    if given and len(given) != len(images):
        raise ValueError(
            f"{flag} must be one file a depth image, or a folder of files of their "
            f"names, got {len(given)} for {len(images)}"
        )
    return list(given)


@contextlib.contextmanager
def hints_on_stderr() -> Iterator[None]:
    """Print a fit's hints as lines of their own, without the code that gave them."""
    from impostor_jax.fit.regions import DepthUnitsWarning

    with warnings.catch_warnings():
        plain = warnings.showwarning

        def show(message: Any, category: Any, *where: Any, **more: Any) -> None:
            if issubclass(category, DepthUnitsWarning):
                print(f"impostor-jax: warning: {message}", file=sys.stderr)
            else:
                plain(message, category, *where, **more)

        warnings.simplefilter("always", DepthUnitsWarning)
        warnings.showwarning = show
        yield
