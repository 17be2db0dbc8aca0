import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.io.mesh_export import to_mesh, write_mesh
from tests.cases import PRIMITIVES, TURNED, pose
from tests.groups import FULL, RELEASE

trimesh = pytest.importorskip("trimesh")
pytest.importorskip("manifold3d")

CENTER, AXIS = (0.1, -0.2, 3.0), (0.3, 0.8, 0.52)
TOLERANCE = 0.01

CLOSED = {
    "cylinder": (ij.Cylinder(CENTER, AXIS, 0.5, 1.4), np.pi * 0.25 * 1.4),
    "sector": (
        ij.Cylinder(CENTER, AXIS, 0.5, 1.4, 6.0, 10.0, (1, 0, 0)),
        0.5 * 4.0 * 0.25 * 1.4,
    ),
    "frustum": (
        ij.Frustum((0, 0, 3), (0.3, 0.4, 3), 0.5, 0.2),
        np.pi * 0.5 / 3 * (0.25 + 0.1 + 0.04),
    ),
    "cone": (ij.Frustum((0, 0, 3), (0.3, 0.4, 3), 0.0, 0.4), np.pi * 0.5 / 3 * 0.16),
    "sector of a cone": (
        ij.Frustum((0, 0, 3), (0.3, 0.4, 3), 0.4, 0.0, 0.0, 2.0),
        0.5 * 2.0 * 0.5 / 3 * 0.16,
    ),
    "sphere": (ij.Sphere(CENTER, 0.5), np.pi * 4 / 3 * 0.125),
    "box": (ij.Box(CENTER, TURNED, (0.8, 0.6, 1.4)), 0.8 * 0.6 * 1.4),
    "torus": (ij.Torus(CENTER, AXIS, 0.5, 0.2), 2 * np.pi**2 * 0.5 * 0.04),
}


def on(mesh, count=3000):
    """Points of a mesh: its corners, the middles of faces and edges, and others."""
    rng = np.random.default_rng(0)
    weight = rng.dirichlet((1, 1, 1), count)
    weight[: count // 3] = 1 / 3
    weight[count // 3 : count // 2] = 0.5, 0.5, 0
    weight[count // 2 : 2 * count // 3] = 0, 0.5, 0.5
    face = rng.integers(0, len(mesh.faces), count)
    return np.einsum("nk,nkx->nx", weight, mesh.triangles[face])


def implicit(shape, points):
    return np.asarray(shape.implicit(Vec3.from_array(jnp.asarray(points, shape.dtype))))


def check_near(shape, mesh, tolerance):
    # What single precision makes of points 3 m away is a ten-thousandth of it.
    assert np.abs(implicit(shape, on(mesh))).max() <= 1.001 * tolerance


@pytest.mark.parametrize("name", CLOSED)
def test_a_mesh_of_a_closed_shape_is_closed_and_near_its_surface(name):
    shape, volume = CLOSED[name]
    for tolerance in (0.2, TOLERANCE):
        mesh = ij.to_mesh(shape, tolerance)
        assert mesh.is_watertight
        assert mesh.is_winding_consistent
        check_near(shape, mesh, tolerance)
        # All corners lie on the surface: of what is convex the mesh is too small.
        assert -1e-6 < volume - mesh.volume < mesh.area * tolerance or name == "torus"
        assert abs(mesh.volume - volume) < mesh.area * tolerance
    corners = np.resize(mesh.vertices, (3000, 3))
    assert np.abs(implicit(shape, corners)).max() < 2e-6


def test_the_tolerance_is_used():
    # A mesh that is finer than it need be would be of no use.
    for shape, _ in CLOSED.values():
        mesh = to_mesh(shape, TOLERANCE)
        if not isinstance(shape, ij.Box):
            assert np.abs(implicit(shape, on(mesh))).max() > 0.4 * TOLERANCE


@pytest.mark.parametrize(
    ("caps", "cut_faces", "borders"),
    [(False, False, 1), (False, True, 2), (True, False, 1)],
)
def test_what_is_open_stays_open(caps, cut_faces, borders):
    shape = ij.Cylinder(
        CENTER, AXIS, 0.5, 1.4, 0.3, 2.3, caps=caps, cut_faces=cut_faces
    )
    mesh = to_mesh(shape, TOLERANCE)
    assert mesh.is_winding_consistent
    check_near(shape, mesh, TOLERANCE)
    # Edges of one face make the border: a loop each, around the wall or the caps.
    edges = trimesh.grouping.group_rows(mesh.edges_sorted, require_count=1)
    loops = trimesh.graph.connected_components(mesh.edges_sorted[edges])
    assert len(loops) == borders
    tube = to_mesh(ij.Cylinder(CENTER, AXIS, 0.5, 1.4, caps=False), TOLERANCE)
    assert not tube.is_watertight
    assert tube.area == pytest.approx(2 * np.pi * 0.5 * 1.4, rel=0.02)


GRID = [[0.0, 0.3, -0.2], [0.4, -0.3, 0.1], [-0.1, 0.5, 0.2], [0.2, -0.2, 0.0]]
FIELDS = {
    "bilinear": lambda: ij.Heightfield(GRID, ((-0.6, 0.6), (-0.5, 0.7))),
    "bicubic": lambda: ij.Heightfield(
        GRID, ((-0.6, 0.6), (-0.5, 0.7)), "bicubic", world_from_field=pose()
    ),
    "function": lambda: ij.Heightfield(
        lambda x, z: 0.2 * jnp.sin(3 * x) * z, ((0, 1), (0, 1)), lipschitz=0.7
    ),
    "bent function": lambda: ij.Heightfield(
        lambda x, z: 0.2 * jnp.sin(3 * x) * z, ((0, 1), (0, 1)),
        lipschitz=0.7, curvature=2.3,
    ),
}  # fmt: skip


SOME_FIELDS = [pytest.param("bilinear", marks=RELEASE), *list(FIELDS)[1:]]


@FULL
@pytest.mark.parametrize("name", SOME_FIELDS)
def test_a_heightfield_is_an_open_sheet(name):
    field = FIELDS[name]()
    mesh = to_mesh(field, TOLERANCE)
    assert mesh.is_winding_consistent
    assert not mesh.is_watertight
    points, normals = on(mesh), mesh.face_normals
    if field.world_from_field is not None:
        back = field.world_from_field.inverse()
        points = np.asarray(back.apply(jnp.asarray(points, field.dtype)))
        normals = normals @ np.asarray(field.world_from_field.rotation)
    assert np.all(normals[:, 1] > 0)
    x, y, z = jnp.asarray(points.T, field.dtype)
    off = np.abs(np.asarray(y - field.surface(x, z)[0])).max()
    # By the slope alone the bound is of no use to tell.
    assert (0 if name == "function" else 0.1) * TOLERANCE < off <= 1.001 * TOLERANCE


def test_triangles_that_share_corners_stay_together():
    solid = to_mesh(ij.Box((0, 0, 0), np.eye(3), (1, 2, 3)), 1)
    mesh = to_mesh(ij.Triangle(solid.triangles), 1)
    assert mesh.is_watertight
    assert len(mesh.vertices) == 8
    assert mesh.volume == pytest.approx(6)


def test_a_batch_and_a_list_are_one_mesh_in_order():
    balls = ij.Sphere([(0, 0, 1), (0, 0, 1.1)], [0.1, 0.2])
    mesh = to_mesh([balls, ij.Box((3, 0, 0), np.eye(3), (1, 1, 1))], 0.001)
    parts = mesh.split()
    assert len(parts) == 3
    # They overlap and are not united.
    sizes = sorted(part.volume for part in parts)
    exact = [4 / 3 * np.pi * 0.001, 4 / 3 * np.pi * 0.008, 1.0]
    np.testing.assert_allclose(sizes, exact, rtol=0.03)
    np.testing.assert_allclose(mesh.triangles[-1].mean(axis=0)[0], 3, atol=0.6)


BALL, CAN = CLOSED["sphere"][0], CLOSED["cylinder"][0]
FLOOR = ij.Plane((0.1, -0.2, 3.1), (0, 0, 1))


def slab(side, low, high):
    """What is between two planes across x, y or z."""
    way = np.eye(3)[side]
    return ij.Plane(way * high, way) & ij.Plane(way * low, -way)


SOLIDS = {
    "crossing pipes": (
        ij.Cylinder((0, 0, 3), (1, 0, 0), 0.5, 2)
        & ij.Cylinder((0, 0, 3), (0, 1, 0), 0.5, 2),
        16 / 3 * 0.125,
    ),
    "lens": (
        BALL & ij.Sphere((0.1, 0.1, 3.0), 0.5),
        np.pi * (1 - 0.3) ** 2 * (0.3**2 + 4 * 0.3 * 0.5) / (12 * 0.3),
    ),
    "bored can": (CAN - ij.Cylinder(CENTER, AXIS, 0.3, 1.4), np.pi * 0.16 * 1.4),
    "cut ball": (BALL & FLOOR, np.pi * (4 / 3 * 0.125 - 0.4**2 * 1.1 / 3)),
    "rest of a ball": (BALL - FLOOR, np.pi * 0.4**2 * 1.1 / 3),
    "apart": (BALL | ij.Sphere((5, 0, 0), 0.5), np.pi * 8 / 3 * 0.125),
    "block of planes": (
        slab(0, 1, 2) & slab(1, -1, 1) & slab(2, 3.5, 4),
        1.0,
    ),
    "block of ground": (
        ij.Heightfield([[1, 2], [1, 2]], ((0, 1), (0, 2)))
        - ij.Plane((0, 0.5, 0), (0, 1, 0)),
        2 * (1.5 - 0.5),
    ),
    "tunnel": (
        (ij.Heightfield([[1, 1], [1, 1]], ((0, 1), (0, 2)))
         & ij.Box((0.5, 0.5, 1), np.eye(3), (3, 1, 3)))
        - ij.Box((0.5, 0.25, 1), np.eye(3), (0.5, 0.5, 9)),
        2 - 0.5 * 0.5 * 2,
    ),
    "moved": ((CAN - BALL | CAN).transformed(pose()), np.pi * 0.25 * 1.4),
}  # fmt: skip


@FULL
@pytest.mark.parametrize("name", SOLIDS)
def test_a_solid_has_its_volume(name):
    solid, volume = SOLIDS[name]
    mesh = to_mesh(solid, TOLERANCE)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert abs(mesh.volume - volume) < mesh.area * TOLERANCE
    check_near(solid, mesh, TOLERANCE)


def test_a_batch_of_solids_is_one_mesh():
    rings = ij.Cylinder(
        [(0, 0, 0), (0, 0, 3)], [(0, 0, 1)] * 2, (1, 2), (1, 1)
    ) - ij.Plane((0, 0, 0), (0, 1, 0))
    mesh = to_mesh(rings, 0.001)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(np.pi / 2 * (1 + 4), rel=0.01)


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        (FLOOR, "a plane must be cut by a solid"),
        (FLOOR | BALL, "a solid must have an end to have a mesh, got one that reaches"),
        (FLOOR - BALL, "must have an end"),
        (ij.union(FIELDS["bilinear"]()), "must have an end"),
        (BALL - ij.Sphere(CENTER, 0.6), "a solid must hold something"),
        ([], r"shape must be a primitive, or a sequence of them, got \[\]"),
    ],
)  # fmt: skip
def test_what_has_no_mesh_is_named(shape, message):
    with pytest.raises(ValueError, match=message):
        to_mesh(shape, TOLERANCE)


def test_a_bad_tolerance_is_named():
    for bad in (0, -1, np.inf, "fine", [1, 2]):
        with pytest.raises(ValueError, match="tolerance must be a positive number in"):
            to_mesh(BALL, bad)
    for shape in (BALL, CAN, CLOSED["torus"][0], FIELDS["bicubic"]()):
        with pytest.raises(ValueError, match="tolerance must be larger, in meters"):
            to_mesh(shape, 1e-16)


def test_a_traced_shape_is_refused():
    with pytest.raises(ValueError, match="must have numbers to be a mesh"):
        jax.jit(lambda ball: to_mesh(ball, 0.1).vertices)(BALL)


@pytest.mark.parametrize("module", ["trimesh", "manifold3d"])
def test_missing_extra_is_named(module, monkeypatch):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ValueError, match=r"pip install 'impostor-jax\[mesh\]'"):
        to_mesh(BALL - CAN, TOLERANCE)


@pytest.mark.parametrize("kind", ["ply", "stl", "obj", "glb", "PLY"])
def test_a_file_is_read_as_it_was_written(kind, tmp_path):
    mesh = to_mesh(BALL, TOLERANCE)
    path = tmp_path / f"out.{kind}"
    write_mesh(path, mesh, scale=0.001)
    found = ij.read_mesh(path, scale=0.001)
    np.testing.assert_allclose(found.vertices, mesh.triangles, atol=1e-6)
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_another_format_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"path must end in one of \.glb, \.obj"):
        write_mesh(tmp_path / "out.step", to_mesh(BALL, TOLERANCE))


def random_leaf(rng):
    c = np.array([0, 0, 3]) + rng.uniform(-0.4, 0.4, 3)
    a, r = rng.normal(size=3), rng.uniform(0.3, 0.7)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    return [
        lambda: ij.Sphere(c, r),
        lambda: ij.Cylinder(c, a, 0.7 * r, 2.5 * r),
        lambda: ij.Frustum(c - 0.6 * a, c + 0.6 * a, r, 0.3 * r),
        lambda: ij.Box(c, turn, 2 * r * rng.uniform(0.5, 1, 3)),
        lambda: ij.Torus(c, a, r, 0.4 * r),
        lambda: ij.Plane(c, a),
        lambda: ij.Cylinder(c, a, r, 2 * r, 0.0, rng.uniform(1, 5)),
    ][rng.integers(7)]()


def random_solid(seed):
    """Solid in solids, in a ball so that it has an end; it has a pose of its own."""
    rng = np.random.default_rng(seed)

    def tree(depth):
        if depth == 0 or rng.uniform() < 0.2:
            return random_leaf(rng)
        operation = (ij.union, ij.intersection, ij.difference)[rng.integers(3)]
        return operation(tree(depth - 1), tree(depth - 1))

    whole = ij.Sphere((0, 0, 3), 0.9)
    return turned(whole & (tree(2) | random_leaf(rng)))


def turned(solid):
    """The solid, turned about a point before the camera."""
    rotation = np.asarray(pose().rotation)
    middle = np.array([0, 0, 3])
    return solid.transformed(ij.RigidTransform(rotation, middle - rotation @ middle))


def crossings(origin, direction, mesh):
    """Ray parameters at which rays meet triangles, (rays, triangles); else infinite."""
    a, b, c = np.moveaxis(mesh.triangles, 1, 0)
    normal = np.cross(b - a, c - a)
    slope = direction @ normal.T
    t = (np.sum(normal * a, axis=1) - origin @ normal.T) / slope
    inside = np.ones(t.shape, bool)
    for first, second in ((a, b), (b, c), (c, a)):
        # Which way a ray passes an edge, the same for both its sides.
        moment = np.cross(first, second)
        way = direction @ moment.T + np.cross(origin, direction) @ (second - first).T
        inside &= way * np.sign(slope) > 0
    return np.where(inside & (t > 0), t, np.inf)


MORE = [pytest.param(seed, marks=RELEASE) for seed in range(3, 11)]


@pytest.mark.parametrize("seed", [1, *MORE])
def test_a_random_solid_holds_the_points_of_its_mesh(seed):
    solid, tolerance = random_solid(seed), 0.002
    mesh = to_mesh(solid, tolerance)
    assert mesh.is_watertight
    check_near(solid, mesh, tolerance)
    low, high = mesh.bounds
    rng = np.random.default_rng(seed)
    points = rng.uniform(low - 0.05, high + 0.05, (3000, 3))
    value = implicit(solid, points)
    met = np.isfinite(crossings(points, rng.normal(size=points.shape), mesh))
    inside = np.sum(met, axis=1) % 2 == 1
    decided = np.abs(value) > tolerance
    np.testing.assert_array_equal(inside[decided], (value < 0)[decided])
    # Of as many points, 4 deviations are 4 % of the box, at most.
    volume = np.mean(value < 0) * np.prod(high - low + 0.1)
    assert volume == pytest.approx(mesh.volume, abs=0.037 * np.prod(high - low + 0.1))


def differs(values):
    """Pixels beside one that has another value."""
    wide = np.pad(values, 1, mode="edge")
    h, w = values.shape
    around = [wide[i : i + h, j : j + w] for i in range(3) for j in range(3)]
    return np.any([x != values for x in around], axis=0)


def cut_cup():
    """A can with a bore that goes through one end, cut off aslant, and a knob."""
    can = ij.Cylinder((0, 0, 3), (0.3, 0.8, 0.52), 0.5, 1.4)
    bore = ij.Cylinder((0.1, 0.3, 3.2), (0.3, 0.8, 0.52), 0.35, 1.4)
    knob = ij.Sphere((0.45, 0.1, 2.8), 0.2)
    return turned((can - bore | knob) - ij.Plane((0.2, 0.3, 3.0), (-0.1, -0.9, 0.2)))


@FULL
@pytest.mark.parametrize("seed", [None, *MORE])
def test_a_solid_is_seen_where_its_mesh_is(seed):
    tolerance = 0.002
    solid = cut_cup() if seed is None else random_solid(seed)
    mesh = to_mesh(solid, tolerance)
    camera = ij.PinholeCamera(60.0, 62.0, 31.4, 23.3, 64, 48)
    maps = ij.render(solid, camera, ("depth", "normal", "mask", "part"))
    ray = camera.rays(*camera.frame.pixels(), solid.dtype)
    way = np.asarray(ray.direction.stack(), float).reshape(-1, 3)
    t = crossings(np.zeros_like(way), way, mesh).min(axis=1).reshape(48, 64)
    mask, part = np.asarray(maps.mask), np.asarray(maps.part)
    # A pixel is 5 cm at 3 m, and the mesh is off by 2 mm at most.
    steady = ~(differs(part) | differs(np.isfinite(t)))
    assert np.mean(steady) > 0.5
    assert np.sum(mask & steady) > 50
    np.testing.assert_array_equal(np.isfinite(t)[steady], mask[steady])
    both = steady & mask
    slope = np.abs(np.sum(np.asarray(maps.normal) * way.reshape(48, 64, 3), axis=-1))
    off = np.abs(np.asarray(maps.depth)[both] - t[both]) * slope[both]
    # Off a chord to either side; where it bends, so does its slope.
    assert np.max(off) < 2 * tolerance


@pytest.mark.parametrize("name", ["cylinder", "bored can", "triangle"])
def test_a_mesh_far_off_is_as_fine_as_one_near(name):
    place = np.array([512345.678, 5412345.678, 250.0])
    shape = PRIMITIVES[name]()
    near = ij.to_mesh(shape, 0.01)
    far = ij.to_mesh(shape.transformed(ij.RigidTransform(np.eye(3), place)), 0.01)
    np.testing.assert_array_equal(far.faces, near.faces)
    np.testing.assert_allclose(far.vertices - place, near.vertices, rtol=0, atol=1e-6)
