"""OpenCV, of any of the four distributions that hold it.

They write the same files over each other's: where two are installed one is damaged, and
where one of the two is removed nothing works. This package uses what all four have: no
module of contrib, and no windows.
"""

__all__ = ["advice", "cv2", "distributions"]

import importlib.metadata

DISTRIBUTIONS = (
    "opencv-contrib-python-headless",
    "opencv-contrib-python",
    "opencv-python-headless",
    "opencv-python",
)
"""The first is the one that this package asks for."""


def distributions() -> dict[str, str]:
    """Versions of those that are installed, by name."""
    versions = {}
    for name in DISTRIBUTIONS:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return versions


def advice() -> str:
    """How to come to a single one."""
    there = distributions()
    if not there:
        return f"run: pip install {DISTRIBUTIONS[0]}"
    found = ", ".join(f"{name} {version}" for name, version in there.items())
    return (
        f"its distributions overwrite each other, and there is {found}; run: pip "
        f"uninstall --yes {' '.join(there)}, then: pip install {DISTRIBUTIONS[0]}"
    )


try:
    import cv2

    # What is left where one of two was removed can be imported, and is empty.
    cv2.imread  # noqa: B018
except (ImportError, AttributeError) as error:
    raise ImportError(f"cv2 must be whole, got: {error}; {advice()}") from error
