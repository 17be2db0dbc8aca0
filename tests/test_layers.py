"""A module imports only from its own layer and those below, and nothing in a circle."""

import ast
import graphlib
from pathlib import Path

import impostor_jax

PACKAGE = Path(impostor_jax.__file__).parent
# From the lowest layer to the highest.
LAYERS = (
    "opencv",
    "numerics",
    "caching",
    "workers",
    "device",
    "program_store",
    "compiling",
    "effort",
    "plain_arguments",
    "arguments",
    "text",
    "geometry",
    "camera",
    "primitives",
    "rendering",
    "sensor",
    "fit",
    "find",
    "clouds",
    "fits",
    "track",
    "calibrate",
    "io",
    "matching",
    "evaluate",
    "evaluate_tracks",
    "viewer",
    "glsl",
    "page",
    "many",
    "parity",
    "cli",
    "__main__",
)
PARTS = {
    path.relative_to(PACKAGE).with_suffix("").parts
    for path in PACKAGE.rglob("*.py")
    if path.name != "__init__.py"
}


def imported(parts: tuple[str, ...]) -> set[tuple[str, ...]]:
    tree = ast.parse(PACKAGE.joinpath(*parts).with_suffix(".py").read_text())
    names = []
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            names += [node.module, *(f"{node.module}.{a.name}" for a in node.names)]
        elif isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
    own = [name.split(".") for name in names if name.startswith("impostor_jax.")]
    return {tuple(parts[1:]) for parts in own} & PARTS


def test_a_module_imports_from_no_higher_layer():
    wrong = [
        f"{'/'.join(parts)} imports {'/'.join(other)}"
        for parts in sorted(PARTS)
        for other in imported(parts)
        if LAYERS.index(other[0]) > LAYERS.index(parts[0])
    ]
    assert not wrong


def test_no_module_needs_itself():
    graphlib.TopologicalSorter({parts: imported(parts) for parts in PARTS}).prepare()


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
        found = getattr(impostor_jax, name).__name__.rpartition(".")[2]
        assert found == RENAMED.get(name, name)
    for name in impostor_jax.io.__all__:
        assert getattr(impostor_jax.io, name) is getattr(impostor_jax, name)


def test_import_of_a_submodule_leaves_the_public_names():
    # The folder was once called render, and hid the function after such an import.
    import impostor_jax.rendering.raycast

    assert callable(impostor_jax.render)
