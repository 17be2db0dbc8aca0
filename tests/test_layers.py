"""A module imports only from layers below its own."""

import ast
from pathlib import Path

import pytest

import impostor_jax

PACKAGE = Path(impostor_jax.__file__).parent
# From the lowest layer to the highest.
LAYERS = (
    "numerics",
    "caching",
    "program_store",
    "compiling",
    "effort",
    "arguments",
    "text",
    "geometry",
    "camera",
    "primitives",
    "rendering",
    "sensor",
    "fit",
    "io",
    "evaluate",
    "viewer",
    "glsl",
    "cli",
    "__main__",
)
# Within a folder a module imports only from those before it.
ORDER = {
    "geometry": ("vec3", "rays", "frames", "so3"),
    "camera": ("pixels", "base", "lens", "pinhole", "orthographic"),
    "primitives": (
        "base",
        "surface",
        "sector",
        "tapered",
        "cylinder",
        "sphere",
        "frustum",
        "plane",
        "torus",
        "box",
        "terrain",
        "heightfield_grid",
        "heightfield_height",
        "heightfield_march",
        "heightfield_cells",
        "heightfield",
    ),
    "rendering": (
        "maps",
        "outline",
        "bounds",
        "scene",
        "blocks",
        "tile",
        "closest",
        "raycast",
        "silhouettes",
        "shadow",
        "shade",
        "polygon",
        "outline_base",
        "sphere_outline",
        "outline_curve",
        "image_curve",
        "coverage",
        "render",
        "distance",
    ),
    "sensor": (
        "draws",
        "base",
        "gaussian",
        "structured_light",
        "lateral",
        "quantization",
        "dropout",
        "flying_pixels",
    ),
    "fit": (
        "robust",
        "depth_loss",
        "rounds",
        "sparse",
        "surface",
        "segment",
        "body",
        "round_body",
        "ball",
        "initialize",
        "guess_sphere",
        "prior",
        "problem",
        "evidence",
        "options",
        "text",
        "result",
        "uncertainty",
        "deviations",
        "agreement",
        "solve",
        "assess",
        "fittable",
        "request",
        "regions",
        "border",
        "shapes",
        "taper",
        "cylinder",
        "frustum",
        "sphere",
        "batch",
        "labels",
    ),
    "io": (
        "atomic",
        "provenance",
        "input_file",
        "json_file",
        "image_header",
        "image_file",
        "depth_image",
        "label_image",
        "camera_file",
        "scene_file",
        "sensor_record",
        "record",
        "run_lengths",
        "dataset_shard",
        "dataset",
    ),
    "viewer": ("figure",),
    "glsl": (
        "conventions",
        "impostors",
        "billboard",
        "program",
        "request",
        "scene",
        "offscreen",
        "webgl",
        "reference",
        "case",
        "cylinder_cases",
        "sphere_cases",
        "frustum_cases",
        "heightfield_cases",
        "flat_cases",
        "cases",
        "compare",
        "known_differences",
        "bounds",
        "parity",
    ),
    "cli": (
        "ending",
        "dials",
        "given",
        "fit",
        "render",
        "demo",
        "evaluate",
        "parity",
        "parse",
    ),
}
MODULES = sorted(
    path.relative_to(PACKAGE).with_suffix("").parts
    for path in PACKAGE.rglob("*.py")
    if path.name != "__init__.py"
)


def imported(path: Path) -> list[tuple[str, ...]]:
    tree = ast.parse(path.read_text())
    names = [
        node.module
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module
    ]
    names += [
        alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.Import)
        for alias in node.names
    ]
    return [
        tuple(name.split(".")[1:]) for name in names if name.startswith("impostor_jax.")
    ]


@pytest.mark.parametrize("parts", MODULES, ids="/".join)
def test_module_imports_only_from_lower_layers(parts):
    layer = LAYERS.index(parts[0])
    for other in imported(PACKAGE.joinpath(*parts).with_suffix(".py")):
        assert LAYERS.index(other[0]) <= layer, f"{parts} imports {other}"
        if other[0] == parts[0] and len(parts) > 1 and len(other) > 1:
            order = ORDER[parts[0]]
            assert order.index(other[1]) < order.index(parts[1]), (parts, other)


# Names of version 0.1.
RENAMED = {
    "FitResult": "Fit",
    "FrustumDeviations": "Deviations",
    "FrustumFit": "Fit",
    "SphereDeviations": "Deviations",
    "SphereFit": "Fit",
}


def test_every_public_name_loads():
    for name in impostor_jax.__all__:
        assert getattr(impostor_jax, name).__name__ == RENAMED.get(name, name)


def test_import_of_a_submodule_leaves_the_public_names():
    # The folder was once called render, and hid the function after such an import.
    import impostor_jax.rendering.raycast

    assert callable(impostor_jax.render)
