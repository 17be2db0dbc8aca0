"""What a tracker makes of small videos."""

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.track.measured import PART
from tests.find.scenes import ORTHOGRAPHIC
from tests.fit.scenes import CAMERA, SIGMA
from tests.groups import FULL, SMALL_IMAGES
from tests.track.scenes import RATE, WALL, can, frame, moved

pytestmark = SMALL_IMAGES

# In front of a can's middle, and of all of it.
OCCLUDER = ij.Box((0.0, 0.0, 0.3), np.eye(3), (0.12, 0.2, 0.02))


def played(tracker, scenes, cameras=None, sigma=SIGMA):
    """Tracks after each image of some scenes."""
    told = []
    for k, shapes in enumerate(scenes):
        camera = CAMERA if cameras is None else cameras[k]
        pose = None if cameras is None else camera.camera_from_world
        depth = frame(shapes, k, camera, sigma)
        told.append(tracker.step(depth, camera_from_world=pose))
    return told


def statuses(told, identity=1):
    return [
        next((str(t.status) for t in tracks if t.identity == identity), "none")
        for tracks in told
    ]


def test_a_can_is_new_and_then_tracked_as_it_moves():
    speed = 0.3
    scenes = [[can(x=-0.05 + speed * k / RATE)] for k in range(12)]
    told = played(ij.Tracker(CAMERA, SIGMA), scenes)
    assert statuses(told) == ["new"] + 11 * ["tracked"]
    assert all(len(tracks) == 1 for tracks in told)
    (last,) = told[-1]
    assert last.num_fits == 12
    assert last.time == pytest.approx(11 / RATE)
    np.testing.assert_allclose(last.velocity, [speed, 0, 0], atol=0.15)
    truth = scenes[-1][0]
    off = np.asarray(last.cylinder.center) - np.asarray(truth.center)
    assert (np.abs(off) < 4.5 * last.std.center).all()
    assert last.mask.sum() > 800
    assert last.fit.success


def test_identity_survives_what_hides_it():
    # Two cans, one of which something hides for 20 images, as it moves.
    hidden = range(6, 26)
    scenes = []
    for k in range(30):
        shapes = [can(x=-0.03 + 0.002 * k), can(x=0.13, radius=0.03)]
        scenes.append([*shapes, OCCLUDER] if k in hidden else shapes)
    told = played(ij.Tracker(CAMERA, SIGMA, acceleration=0.2), scenes)
    first = told[0][0].identity if told[0][0].cylinder.center[0] < 0.1 else 2
    found = statuses(told, first)
    assert found[:6] == ["new"] + 5 * ["tracked"]
    assert found[6:26] == 20 * ["lost"]
    assert found[26:] == 4 * ["tracked"]
    assert statuses(told, 3 - first)[1:] == 29 * ["tracked"]
    assert all(len(tracks) == 2 for tracks in told)
    lost = next(t for t in told[25] if t.identity == first)
    assert "hides" in lost.reason
    assert lost.fit is None
    assert not lost.mask.any()
    off = np.asarray(lost.cylinder.center) - np.asarray(scenes[25][0].center)
    assert (np.abs(off) < 4 * lost.std.center).all()
    # What is not seen is less sure, and sizes are what they were.
    before = next(t for t in told[5] if t.identity == first)
    assert (lost.std.center > before.std.center).all()
    assert lost.std.radius == before.std.radius


def bar(low, high):
    """What hides a can between two heights, before it."""
    middle = (0.0, (low + high) / 2, 0.3)
    return ij.Box(middle, np.eye(3), (0.2, high - low, 0.02))


@FULL
def test_parts_of_one_wall_are_one_track():
    # Its upper part alone, then both beside what hides the middle.
    begin = 2 * [[can(), bar(-0.02, 0.2)]]
    told = played(
        ij.Tracker(CAMERA, SIGMA, search_every=2),
        begin + 6 * [[can(), bar(-0.01, 0.01)]],
    )
    assert statuses(told) == ["new"] + 7 * ["tracked"]
    assert all(len(tracks) == 1 for tracks in told)
    (first,), (last,) = told[1], told[-1]
    assert first.cylinder.height < 0.05
    assert last.cylinder.height == pytest.approx(float(can().height), abs=0.005)
    # Both parts are shown by its mask.
    rows = np.flatnonzero(last.mask.any(axis=1))
    assert (np.diff(rows) > 1).sum() == 1


def test_cans_in_line_stay_two():
    # Their ends are seen, so neither goes on in the other.
    short = {"height": 0.05}
    pair = [can(**short, y=-0.04), can(**short, y=0.04)]
    told = played(ij.Tracker(CAMERA, SIGMA, search_every=2), 5 * [pair])
    assert all(len(tracks) == 2 for tracks in told)


def test_what_stays_hidden_is_kept_for_as_long_as_asked():
    scenes = [[can()]] + 10 * [[can(), OCCLUDER]]
    told = played(ij.Tracker(CAMERA, SIGMA, patience=6.5 / RATE), scenes)
    assert statuses(told) == ["new"] + 6 * ["lost"] + 4 * ["none"]


def test_what_is_taken_away_is_dropped_sooner():
    scenes = 3 * [[can()]] + 6 * [[]]
    tracker = ij.Tracker(CAMERA, SIGMA, absence=2.5 / RATE, search_every=1)
    told = played(tracker, scenes[:6])
    assert statuses(told) == ["new", "tracked", "tracked", "lost", "lost", "none"]
    assert [track.identity for track in tracker.ended] == [1]
    assert "behind" in told[3][0].reason
    # A number is not given twice.
    (track,) = tracker.step(frame([can(x=0.05)]), time=20 / RATE)
    assert (track.identity, track.status) == (2, "new")


def test_what_leaves_the_image_is_lost_and_dropped():
    scenes = [[can(x=0.12 + 0.02 * k)] for k in range(16)]
    told = played(ij.Tracker(CAMERA, SIGMA, patience=3.5 / RATE), scenes)
    found = statuses(told)
    assert found[1:4] == 3 * ["tracked"]
    assert found[-1] == "none"
    reasons = [tracks[0].reason for tracks in told if tracks]
    assert "image" in reasons[-1]
    assert all(np.isfinite(tracks[0].velocity).all() for tracks in told if tracks)


def test_what_stops_at_once_is_looked_for_before_where_it_was_expected():
    # It is where it would hide what goes on, which nothing hid in the image before.
    scenes = [[can(z=0.5 + 0.025 * min(k, 5))] for k in range(9)]
    tracker = ij.Tracker(CAMERA, SIGMA, search_every=100)
    assert statuses(played(tracker, scenes)) == ["new"] + 8 * ["tracked"]


@FULL
def test_a_box_in_the_place_of_a_can_is_not_the_can():
    box = ij.Box((0.0, 0.0, 0.5), np.eye(3), (0.07, 0.12, 0.07))
    told = played(ij.Tracker(CAMERA, SIGMA), 3 * [[can()]] + 3 * [[box]])
    assert statuses(told)[:4] == ["new", "tracked", "tracked", "lost"]
    (lost,) = (track for track in told[3] if track.identity == 1)
    assert lost.fit is None
    assert lost.std.radius == told[2][0].std.radius


def test_a_can_that_stands_still_is_still_to_a_camera_that_moves():
    steps = [0.01 * k for k in range(12)]
    scenes = 12 * [[can(x=0.05)]]
    told = played(ij.Tracker(CAMERA, SIGMA), scenes, [moved(x) for x in steps])
    assert statuses(told) == ["new"] + 11 * ["tracked"]
    (last,) = told[-1]
    assert (np.abs(last.velocity) < 4 * last.std.velocity).all()
    assert np.linalg.norm(last.velocity) < 0.1
    off = np.asarray(last.cylinder.center) - [0.05, 0.0, 0.5]
    assert (np.abs(off) < 4.5 * last.std.center).all()


def test_far_from_the_origin_places_keep_their_digits():
    place = np.array([512345.678, 5412345.678, 250.0])
    pose = np.eye(4)
    pose[:3, 3] = -place
    tracker = ij.Tracker(CAMERA, SIGMA)
    near = played(ij.Tracker(CAMERA, SIGMA), 3 * [[can()]])[-1][0]
    for k in range(3):
        (track,) = tracker.step(frame([can()], k), camera_from_world=pose)
    off = np.asarray(track.cylinder.center) - place - np.asarray(near.cylinder.center)
    # The fits are the same but for rounding, some micrometers.
    assert np.abs(off).max() < 2e-5
    assert track.std.radius == pytest.approx(near.std.radius, rel=0.05)


def test_a_radius_becomes_surer_with_the_root_of_the_number_of_images():
    told = [track for (track,) in played(ij.Tracker(CAMERA, SIGMA), 17 * [[can()]])]
    single = np.array([float(track.fit.std.radius) for track in told])
    together = np.cumsum(single**-2.0) ** -0.5
    expected = np.hypot(together, PART * np.mean(single))
    found = np.array([track.std.radius for track in told])
    # Pixels of an outline, which images share, are a part of a hundredth.
    np.testing.assert_allclose(found, expected, rtol=0.1)
    assert found[-1] < 0.4 * np.mean(single)
    assert abs(float(told[-1].cylinder.radius) - 0.04) < 4 * found[-1]


@FULL
def test_a_radius_is_no_surer_than_the_scale_of_the_sensor():
    scale, error = 0.01, 0.015
    noise = ij.ScaleError(ij.ConstantNoise(SIGMA, across=0.0, angle=0.0), scale)
    tracker = ij.Tracker(CAMERA, noise)
    for k in range(12):
        depth = frame([can()], k) * (1 + error)
        (track,) = tracker.step(depth)
    radius = float(track.cylinder.radius)
    assert track.std.radius == pytest.approx(scale * 0.04, rel=0.05)
    # The whole scene is larger, and farther away.
    assert radius == pytest.approx((1 + error) * 0.04, abs=1e-4)
    assert track.std.center[2] == pytest.approx(scale * 0.5, rel=0.05)
    assert float(track.cylinder.center[2]) == pytest.approx(0.5 * (1 + error), abs=1e-3)
    # Of a velocity hardly anything is shared.
    assert track.std.velocity[2] < 0.2


def test_a_prior_counts_once_however_many_images_there_are():
    prior = 2e-5
    tracker = ij.Tracker(CAMERA, SIGMA, prior={"radius": (0.04, prior)})
    told = [track for (track,) in played(tracker, 6 * [[can()]])]
    assert [str(track.status) for track in told] == ["new"] + 5 * ["tracked"]
    single = np.array([float(track.fit.std.radius) for track in told])
    together = np.hypot(np.cumsum(single**-2.0) ** -0.5, PART * np.mean(single))
    expected = (prior**-2 + together**-2) ** -0.5
    found = [float(track.std.radius) for track in told]
    # Six times it would be as sure as 0.8e-5.
    np.testing.assert_allclose(found, expected, rtol=0.05)
    assert found[-1] > 1.1e-5
    assert abs(float(told[-1].cylinder.radius) - 0.04) < 3 * prior


def test_what_a_prior_excludes_is_not_followed():
    tracker = ij.Tracker(CAMERA, SIGMA, prior={"radius": (0.06, 0.001)})
    assert played(tracker, [[can()]]) == [()]


def test_images_that_are_left_out_are_seen_in_their_times():
    speed, taken = 0.3, [0, 1, 2, 5, 6, 9, 10, 13]
    tracker = ij.Tracker(CAMERA, SIGMA)
    for k in taken:
        depth = frame([can(x=-0.05 + speed * k / RATE)], k)
        (track,) = tracker.step(depth, time=k / RATE)
    assert track.num_fits == len(taken)
    assert track.time == pytest.approx(13 / RATE)
    off = np.abs(track.velocity - np.array([speed, 0, 0]))
    assert (off < 4 * track.std.velocity).all()
    # By the number of images alone it would be faster by the half.
    assert track.velocity[0] == pytest.approx(speed, abs=0.1)


@FULL
def test_errors_of_a_video_are_as_large_as_said():
    # Cans that move and turn, each in ten images of its own noise.
    errors = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        tracker = ij.Tracker(CAMERA, SIGMA)
        place, velocity = rng.uniform(-0.03, 0.03, 2), rng.uniform(-0.3, 0.3, 2)
        for k in range(10):
            x, y = place + velocity * k / RATE
            truth = can(x, y, 0.5)
            tracks = tracker.step(frame([truth], 100 * seed + k))
            (track,) = tracks
            if k % 3 != 2:
                continue
            off = np.asarray(track.cylinder.center) - np.asarray(truth.center)
            errors.append(
                [
                    *off / track.std.center,
                    float(track.cylinder.radius - truth.radius) / track.std.radius,
                    float(track.cylinder.height - truth.height) / track.std.height,
                ]
            )
    squares = np.mean(np.square(errors), axis=0)
    # Means of a dozen, of which some are related: within a factor of three.
    assert (squares < 3).all()
    assert squares.mean() > 0.2


@FULL
def test_images_that_average_over_their_pixels_draw_no_radius_in():
    # Each drew it in by a deviation or two, and twelve by eight.
    fine = ij.PinholeCamera(450.0, 450.0, 239.5, 179.5, 480, 360)
    depth = ij.render(ij.Scene([WALL, can()]), fine, outputs=("depth",)).depth
    depth = np.asarray(depth).reshape(120, 3, 160, 3).mean(axis=(1, 3))
    tracker = ij.Tracker(CAMERA, SIGMA)
    rng = np.random.default_rng(0)
    for _ in range(12):
        noise = rng.normal(0, SIGMA, depth.shape).astype(np.float32)
        (track,) = tracker.step(depth + noise)
    error = float(track.cylinder.radius) - float(can().radius)
    assert abs(error) < 3 * float(track.std.radius)


@FULL
def test_without_sigma_it_is_measured():
    tracker = ij.Tracker(CAMERA)
    assert tracker.noise is None
    told = played(tracker, 3 * [[can()]])
    assert statuses(told) == ["new", "tracked", "tracked"]
    assert tracker.noise is not None
    assert abs(float(told[2][0].cylinder.radius) - 0.04) < 4 * told[2][0].std.radius


@FULL
def test_noise_that_does_not_graze_as_a_model_says_is_measured():
    # Radii of all images erred the same way, and added up to 6.7 deviations.
    sensor = ij.StructuredLight(floor=SIGMA, growth=0.0, grazing=0.0003)
    tracker = ij.Tracker(CAMERA, sensor)
    told = played(tracker, [[can()]] * 10)
    assert tracker.noise.grazing == 0
    (track,) = told[-1]
    off = float(track.cylinder.radius) - float(can().radius)
    assert abs(off) < 3 * float(track.std.radius)


def test_images_without_readings_leave_tracks_as_they_are():
    tracker = ij.Tracker(CAMERA, SIGMA)
    played(tracker, 2 * [[can()]])
    blank = np.zeros((120, 160), np.float32)
    (track,) = tracker.step(blank)
    assert track.status == "lost"
    (track,) = tracker.step(frame([can()], 9))
    assert (track.identity, track.status) == (1, "tracked")


def test_a_tracker_prints_what_it_knows():
    (track,) = ij.Tracker(CAMERA, SIGMA).step(frame([can()]))
    assert "1: new, radius" in str(track)
    assert track.covariance.shape == (len(track.coordinates),) * 2


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"camera": ORTHOGRAPHIC}, "camera must be a PinholeCamera, got Ortho"),
        ({"sigma": -0.001}, "sigma must be a positive number in meters"),
        ({"frame_rate": 0.0}, "frame_rate must be a positive number"),
        ({"search_every": 0}, "search_every must be a whole number"),
        ({"patience": -1.0}, "patience must be 0 or more seconds"),
        ({"absence": np.nan}, "absence must be"),
        ({"acceleration": 0.0}, "acceleration must be a positive number"),
        ({"gate": 1.5}, "gate must be a probability below 1, got 1.5"),
        ({"radius_range": (0.1, 0.01)}, "radius_range must be the smaller"),
        ({"prior": {"axis": ((0, 1, 0), 0.1)}}, "prior must be one of radius, height"),
        ({"prior": {"radius": (0.04, 0.0)}}, "deviation of .* must be a positive"),
        ({"effort": "quick"}, "effort must be an Effort or one of"),
    ],
)
def test_a_wrong_argument_is_named(changes, message):
    with pytest.raises(ValueError, match=message):
        ij.Tracker(**{"camera": CAMERA, "sigma": SIGMA, **changes})


def test_a_wrong_image_or_time_is_named_and_changes_nothing():
    tracker = ij.Tracker(CAMERA, SIGMA)
    depth = frame([can()])
    (before,) = tracker.step(depth, time=1.0)
    with pytest.raises(ValueError, match=r"time must be later than .* 1\.0 seconds"):
        tracker.step(depth, time=1.0)
    with pytest.raises(ValueError, match="depth must have the camera's shape"):
        tracker.step(depth[1:], time=2.0)
    with pytest.raises(ValueError, match="matrix must be numbers of shape"):
        tracker.step(depth, time=2.0, camera_from_world=np.eye(3))
    (after,) = tracker.step(depth, time=1.1)
    assert (before.status, after.status) == ("new", "tracked")
