"""The same pictures and hits by other programs, where they are installed.

Mitsuba's path integrator is made to do what Whitted's tracer does: it is given the rays
through the centers of the pixels, surfaces that are either dull or a perfect mirror or
clear glass, so that nothing is left to chance, and colors so dark, under lights so
bright, that what dull surfaces throw on each other is `DIM` of what it would be.
"""

__all__ = [
    "drawn_by_mitsuba",
    "hits_by_mitsuba",
    "hits_by_open3d",
    "picture_by_mitsuba",
]

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

import impostor_jax as ij
from experiments.render_speed.peers import (
    has_variant,
    mesh_of,
    module_of,
    solids_of,
)

DIM = 1e-4
"""Part of a color that Mitsuba is given."""

Hits = dict[str, Callable[[], object]]
"""Calls by what they find: the first hits, and whether there is any."""


def picture_by_mitsuba(
    shapes: Sequence[ij.AbstractPrimitive],
    camera: ij.PinholeCamera,
    light: ij.PointLight,
    materials: Sequence[ij.Material],
    depth: int,
) -> Float[np.ndarray, "h w 3"] | None:
    """A traced picture; None where Mitsuba is missing.

    Args:
        shapes: Balls, boxes and whole cylinders, before a black background.
        camera: At the origin, without a lens.
        light: Its intensity falls with the square of the distance.
        materials: Of each: dull, all mirror, or all glass without Fresnel's mirror.
        depth: Most bounces.
    """
    mi = module_of("mitsuba")
    if mi is None:
        return None
    # LLVM 15 cannot compile the paths of mirrored and bent rays.
    mi.set_variant("scalar_rgb")
    mi.set_log_level(mi.LogLevel.Error)
    position = np.asarray(light.position, float).tolist()
    # Dull surfaces divide by pi.
    intensity = (np.asarray(light.intensity, float) * np.pi / DIM).tolist()
    made: dict[str, Any] = {
        "type": "scene",
        "light": {"type": "point", "position": position},
    }
    made["light"]["intensity"] = {"type": "rgb", "value": intensity}
    for number, (shape, material) in enumerate(zip(shapes, materials, strict=True)):
        for name, part in _parts(mi, shape).items():
            made[f"{name} {number}"] = part | {"bsdf": _bsdf(material)}
    row, col = np.mgrid[: camera.height, : camera.width]
    x = (col - float(camera.cx)) / float(camera.fx)
    y = (row - float(camera.cy)) / float(camera.fy)
    rays = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    # The first hit and the last light count as bounces, and chance ends no path.
    settings = {"max_depth": depth + 2, "rr_depth": depth + 3}
    integrator = mi.load_dict({"type": "path", **settings})
    sampler, scene = _certain(mi), mi.load_dict(made)

    def seen(direction: list[float]) -> Any:
        ray = mi.RayDifferential3f(mi.Ray3f(mi.Point3f(0), mi.Vector3f(direction)))
        return integrator.sample(scene, sampler, ray)[0]

    colors = [np.array(seen(direction)) for direction in rays.tolist()]
    return np.reshape(colors, (camera.height, camera.width, 3))


def _certain(mi: Any) -> Any:
    """A sampler whose choice is what is never improbable: glass lets all through."""

    class Certain(mi.Sampler):
        def next_1d(self, active: Any = True) -> Any:
            return mi.Float(1 - 1e-6)

        def next_2d(self, active: Any = True) -> Any:
            return mi.Point2f(0.5)

    sampler = Certain(mi.Properties())
    sampler.seed(0, 1)
    return sampler


def _bsdf(material: ij.Material) -> dict[str, Any]:
    if material.transmit is not None and np.all(material.transmit > 0):
        through = np.asarray(material.transmit).item()
        ior = np.asarray(material.ior).item()
        return {
            "type": "dielectric",
            "int_ior": ior,
            "ext_ior": 1.0,
            "specular_transmittance": {"type": "rgb", "value": through},
        }
    if material.reflect is not None and np.all(material.reflect > 0):
        part = {"type": "rgb", "value": np.asarray(material.reflect).item()}
        mirror = {"type": "conductor", "material": "none"}
        mirror = mirror | {"specular_reflectance": part}
        return {"type": "twosided", "bsdf": mirror}
    color = (DIM * np.asarray(material.color, float)).tolist()
    dull = {"type": "diffuse", "reflectance": {"type": "rgb", "value": color}}
    return {"type": "twosided", "bsdf": dull}


def _parts(mi: Any, shape: ij.AbstractPrimitive) -> dict[str, Any]:
    """What Mitsuba makes a shape of."""
    if isinstance(shape, ij.Cylinder):
        return solids_of(mi, shape)
    assert isinstance(shape, ij.Sphere | ij.Box)
    center = np.asarray(shape.center, float).tolist()
    if isinstance(shape, ij.Sphere):
        radius = np.asarray(shape.radius).item()
        return {"ball": {"type": "sphere", "center": center, "radius": radius}}
    turned = np.eye(4)
    # Its cube goes from -1 to 1.
    turned[:3, :3] = np.asarray(shape.rotation, float) * np.asarray(shape.size) / 2
    turned[:3, 3] = center
    place = mi.ScalarTransform4f(turned)
    return {"cube": {"type": "cube", "to_world": place}}


def drawn_by_mitsuba(
    balls: Sequence[ij.AbstractPrimitive],
    camera: ij.PinholeCamera,
    materials: Sequence[ij.Material],
    depth: int,
) -> Callable[[], object] | None:
    """A call that draws balls with a path through each pixel; None without Mitsuba.

    Under one light of each kind, and with chance to choose between the part of a
    surface that is a mirror and that which is dull: what it costs, not what it shows.
    """
    mi = module_of("mitsuba")
    if mi is None:
        return None
    mi.set_variant("scalar_rgb")
    angle = 2 * np.degrees(np.arctan(camera.width / 2 / float(camera.fx)))
    film = {"type": "hdrfilm", "rfilter": {"type": "box"}}
    film |= {"width": camera.width, "height": camera.height}
    view = mi.ScalarTransform4f().look_at([0, 0, 0], [0, 0, 1], [0, -1, 0])
    made: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": depth + 2, "rr_depth": depth + 3},
        "sensor": {"type": "perspective", "fov": angle, "to_world": view, "film": film},
        "all around": {"type": "constant"},
        "point": {"type": "point", "position": [2, -1, 0]},
        "sun": {"type": "directional", "direction": [-1, 4, -4]},
    }
    for number, (ball, material) in enumerate(zip(balls, materials, strict=True)):
        part = _parts(mi, ball)["ball"]
        weight = np.asarray(material.reflect).item()
        mixed = {"type": "blendbsdf", "weight": weight}
        mixed |= {"dull": {"type": "diffuse"}, "mirror": {"type": "conductor"}}
        made[f"ball {number}"] = part | {"bsdf": mixed}
    scene = mi.load_dict(made)
    return lambda: np.array(mi.render(scene, spp=1))


def hits_by_mitsuba(
    shapes: ij.Sphere | ij.Cylinder,
    origin: Float[np.ndarray, "n 3"],
    direction: Float[np.ndarray, "n 3"],
) -> Hits:
    """First hits of rays at a batch; none where Mitsuba is missing."""
    mi, dr = module_of("mitsuba"), module_of("drjit")
    if mi is None or dr is None or not has_variant(mi):
        return {}
    if isinstance(shapes, ij.Cylinder):
        solids = solids_of(mi, shapes)
    else:
        places = zip(np.asarray(shapes.center, float), shapes.radius, strict=True)
        solids = {
            f"ball {k}": {
                "type": "sphere",
                "center": center.tolist(),
                "radius": float(radius),
            }
            for k, (center, radius) in enumerate(places)
        }
    scene = mi.load_dict({"type": "scene", **solids})
    unit = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    ray = mi.Ray3f(*(kind(x.T.astype(np.float32)) for kind, x in (
        (mi.Point3f, origin), (mi.Vector3f, unit),
    )))  # fmt: skip

    @dr.freeze
    def first(ray: Any) -> Any:
        return scene.ray_intersect_preliminary(ray, coherent=False).t

    @dr.freeze
    def blocked(ray: Any) -> Any:
        return scene.ray_test(ray, coherent=False)

    def done(frozen: Callable[[Any], Any]) -> Callable[[], None]:
        def call() -> None:
            dr.eval(frozen(ray))
            dr.sync_thread()

        return call

    return {"first": done(first), "blocked": done(blocked)}


def hits_by_open3d(
    shapes: ij.Cylinder,
    origin: Float[np.ndarray, "n 3"],
    direction: Float[np.ndarray, "n 3"],
) -> Hits:
    """First hits of rays at meshes of a batch; none where Open3D is missing."""
    o3d = module_of("open3d")
    if o3d is None:
        return {}
    scene = o3d.t.geometry.RaycastingScene()
    points, triangles = mesh_of(shapes)
    scene.add_triangles(o3d.core.Tensor(points), o3d.core.Tensor(triangles))
    rays = np.concatenate([origin, direction], axis=1).astype(np.float32)
    rays = o3d.core.Tensor(rays)
    return {
        "first": lambda: scene.cast_rays(rays),
        "blocked": lambda: scene.test_occlusions(rays),
    }
