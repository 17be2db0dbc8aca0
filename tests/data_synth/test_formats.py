"""What is written, as readers see it that others wrote."""

import gc
import hashlib
import io
import itertools
import json
import subprocess
import tarfile

import cv2
import numpy as np
import pytest

import impostor_jax as ij
from data_synth.preset import Preset
from impostor_jax.io.dataset import read_dataset
from impostor_jax.io.run_lengths import mask_of_rle, rle_of_mask
from tests.data_synth.small import (
    COUNT,
    HEIGHT,
    SHARD_SIZE,
    SMALL,
    WIDTH,
    checksums,
)
from tests.groups import DATASETS

pytestmark = DATASETS


def scenes(folder):
    return sorted((folder / "train").iterdir())


def labels(scene, name):
    return json.loads((scene / f"{name}.json").read_text())


def masks(scene, folder, number, count):
    return np.stack(
        [
            cv2.imread(str(scene / folder / f"{number:06d}_{k:06d}.png"), -1) > 0
            for k in range(count)
        ]
    )


def test_every_image_has_its_files_and_labels(bop):
    found = 0
    for scene in scenes(bop):
        camera, gt, info = (
            labels(scene, f"scene_{name}") for name in ("camera", "gt", "gt_info")
        )
        for number in range(len(camera)):
            found += 1
            depth = cv2.imread(
                str(scene / "depth" / f"{number:06d}.png"), cv2.IMREAD_UNCHANGED
            )
            assert (depth.dtype, depth.shape) == (np.uint16, (HEIGHT, WIDTH))
            assert camera[str(number)]["depth_scale"] == SMALL.depth_scale_mm
            assert len(camera[str(number)]["cam_K"]) == 9
            assert len(gt[str(number)]) == len(info[str(number)])
    assert found == COUNT
    assert len(scenes(bop)) == -(-COUNT // SHARD_SIZE)


def test_visibility_is_that_of_the_masks(bop):
    hidden = 0
    for scene in scenes(bop):
        for number, entries in labels(scene, "scene_gt_info").items():
            whole, seen = (
                masks(scene, name, int(number), len(entries))
                for name in ("mask", "mask_visib")
            )
            depth = cv2.imread(str(scene / "depth" / f"{int(number):06d}.png"), -1)
            assert not (seen & ~whole).any()
            assert (seen.sum(axis=0) <= 1).all()
            for k, entry in enumerate(entries):
                inside = int(whole[k].sum())
                assert entry["px_count_all"] >= inside
                x, y, width, height = entry["bbox_obj"]
                is_inside = (
                    x > 0 and y > 0 and x + width < WIDTH and y + height < HEIGHT
                )
                if is_inside:
                    assert entry["px_count_all"] == inside
                    assert cv2.boundingRect(whole[k].astype(np.uint8)) == (
                        x, y, width, height,
                    )  # fmt: skip
                assert entry["px_count_visib"] == seen[k].sum()
                assert entry["px_count_valid"] == (whole[k] & (depth > 0)).sum()
                fraction = seen[k].sum() / entry["px_count_all"]
                assert entry["visib_fract"] == pytest.approx(fraction)
                if seen[k].any():
                    box = cv2.boundingRect(seen[k].astype(np.uint8))
                    assert entry["bbox_visib"] == list(box)
                hidden += inside - seen[k].sum()
    assert hidden > 0


def test_a_mesh_at_its_pose_covers_the_mask(bop):
    """Meshes, poses and intrinsics together, as a reader of the format draws them."""
    for scene in scenes(bop):
        camera, gt = (labels(scene, f"scene_{name}") for name in ("camera", "gt"))
        for number, poses in gt.items():
            matrix = np.reshape(camera[number]["cam_K"], (3, 3))
            whole = masks(scene, "mask", int(number), len(poses))
            for pose, mask in zip(poses, whole, strict=True):
                points = mesh_points(bop, pose["obj_id"])
                rotation = np.reshape(pose["cam_R_m2c"], (3, 3))
                np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
                moved = points @ rotation.T + pose["cam_t_m2c"]
                projected = moved @ matrix.T
                pixels = projected[:, :2] / projected[:, 2:]
                hull = cv2.convexHull(np.rint(64 * pixels).astype(np.int32))
                drawn = np.zeros((HEIGHT, WIDTH), np.uint8)
                cv2.fillConvexPoly(drawn, hull, 1, shift=6)
                # OpenCV fills the pixels that the edge touches, too.
                assert not (mask & (drawn == 0)).any()
                edge = cv2.dilate(mask.astype(np.uint8), np.ones((3, 3)))
                assert not (drawn & ~edge).any()


def mesh_points(folder, number):
    text = (folder / "models" / f"obj_{number:06d}.ply").read_text()
    header, _, body = text.partition("end_header\n")
    count = int(header.split("element vertex ")[1].split()[0])
    return np.loadtxt(io.StringIO(body), max_rows=count)


def test_models_have_the_sizes_of_their_meshes_and_the_symmetries_of_a_cylinder(bop):
    info = json.loads((bop / "models" / "models_info.json").read_text())
    assert len(info) == SMALL.objects
    for number, record in info.items():
        points = mesh_points(bop, int(number))
        for k, axis in enumerate("xyz"):
            extent = points[:, k].max() - points[:, k].min()
            assert record[f"size_{axis}"] == pytest.approx(extent, rel=2e-3)
        assert record["symmetries_continuous"] == [
            {"axis": [0, 0, 1], "offset": [0, 0, 0]}
        ]
        (flip,) = record["symmetries_discrete"]
        np.testing.assert_array_equal(np.reshape(flip, (4, 4)), np.diag([1, -1, -1, 1]))


def test_meshes_are_closed_and_look_outwards(bop):
    text = (bop / "models" / "obj_000001.ply").read_text()
    points = mesh_points(bop, 1)
    faces = np.loadtxt(io.StringIO(text.split("end_header\n")[1]), skiprows=len(points))
    corners = points[faces[:, 1:].astype(int)]
    volume = (
        np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    )
    info = json.loads((bop / "models" / "models_info.json").read_text())["1"]
    exact = np.pi / 4 * info["size_x"] ** 2 * info["size_z"]
    assert volume == pytest.approx(exact, rel=3e-3)
    edges = np.sort(faces[:, [1, 2, 2, 3, 3, 1]].reshape(-1, 2), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    assert (counts == 2).all()


def test_the_sidecar_renders_the_clean_depth(bop):
    image = read_dataset(bop)[0]
    scene = scenes(bop)[0]
    label = labels(scene, "scene_cylinders")["0"]
    planes = [ij.Plane(p["point_m"], p["normal"]) for p in label["planes"]]
    seen = ij.render(
        ij.Scene([image.cylinders, *planes]), image.camera, ("depth", "normal")
    )
    clean = cv2.imread(str(scene / "depth_clean" / "000000.png"), -1)
    expected = np.asarray(seen.depth) / 1e-4
    expected[expected > 65534] = 0
    np.testing.assert_allclose(clean, expected, atol=0.51)
    colors = cv2.imread(str(scene / "normal" / "000000.png"))[..., ::-1]
    np.testing.assert_allclose(
        colors, 127.5 * np.asarray(seen.normal) + 127.5, atol=0.51
    )


def test_a_reader_gets_the_same_of_folders_and_archives(bop, archives):
    pairs = itertools.zip_longest(read_dataset(bop), read_dataset(archives))
    count = 0
    for one, other in pairs:
        count += 1
        assert one.key == other.key
        np.testing.assert_array_equal(one.depth, other.depth)
        np.testing.assert_array_equal(one.mask, other.mask)
        np.testing.assert_array_equal(one.cylinders.center, other.cylinders.center)
        np.testing.assert_array_equal(one.visible_fraction, other.visible_fraction)
        assert one.camera.fx == other.camera.fx
    assert count == COUNT


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of its own arrays
def test_pycocotools_reads_the_masks_of_archives(bop, archives):
    mask = pytest.importorskip("pycocotools.mask")
    for archive, scene in zip(
        sorted(archives.glob("train/*.tar")), scenes(bop), strict=True
    ):
        with tarfile.open(archive) as file:
            for member in file:
                key, _, part = member.name.partition(".")
                if part not in ("mask.json", "mask_visib.json"):
                    continue
                runs = json.load(file.extractfile(member))
                number = int(key.split("_")[1])
                expected = masks(scene, part.partition(".")[0], number, len(runs))
                for k, run in runs.items():
                    packed = mask.frPyObjects(run, HEIGHT, WIDTH)
                    np.testing.assert_array_equal(mask.decode(packed), expected[int(k)])


# It leaves files to the garbage collector.
@pytest.mark.filterwarnings("ignore::ResourceWarning")
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_webdataset_reads_archives(archives):
    webdataset = pytest.importorskip("webdataset")
    shards = sorted(map(str, archives.glob("train/*.tar")))
    samples = list(webdataset.WebDataset(shards, shardshuffle=False))
    gc.collect()
    assert len(samples) == COUNT
    keys = json.loads((archives / "train" / "key_to_shard.json").read_text())
    assert [sample["__key__"] for sample in samples] == list(keys)
    for sample in samples:
        depth = cv2.imdecode(np.frombuffer(sample["depth.png"], np.uint8), -1)
        assert depth.shape == (HEIGHT, WIDTH)
        assert len(json.loads(sample["gt.json"])) == len(
            json.loads(sample["mask_visib.json"])
        )


def test_checksums_are_those_of_the_files(bop, archives):
    for folder in (bop, archives):
        sums = checksums(folder)
        last = "checksums/checksums.sha256"
        made = {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file()}
        assert set(sums) == made - {"manifest.json", last}
        for name, digest in sums.items():
            assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest
        manifest = json.loads((folder / "manifest.json").read_text())
        digest = hashlib.sha256((folder / last).read_bytes()).hexdigest()
        assert manifest["checksums_sha256"] == digest


def test_the_system_checks_all_checksums(bop):
    done = subprocess.run(
        "sha256sum --check --strict --quiet checksums/*", cwd=bop, shell=True
    )
    assert done.returncode == 0


def test_archives_hold_no_time_and_no_owner(archives):
    for path in archives.glob("train/*.tar"):
        with tarfile.open(path) as file:
            for member in file:
                assert (member.mtime, member.uid, member.uname) == (0, 0, "")


def test_the_manifest_holds_the_preset_and_its_maker(bop):
    record = json.loads((bop / "manifest.json").read_text())
    assert Preset.from_record(record["preset"]) == SMALL
    assert record["seed"] == 7
    assert set(record["made_by"]) >= {"jax", "jaxlib", "numpy", "commit", "cpu"}


@pytest.mark.parametrize(
    "mask",
    [
        np.zeros((3, 4), bool),
        np.ones((3, 4), bool),
        np.eye(3, 4, dtype=bool),
        ~np.eye(3, 4, dtype=bool),
    ],
)
def test_run_lengths_give_the_mask_back(mask):
    record = rle_of_mask(mask)
    assert sum(record["counts"]) == mask.size
    np.testing.assert_array_equal(mask_of_rle(record, mask.shape), mask)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"size": [4, 3]}, r"size of a mask must be \[3, 4\], got \[4, 3\]"),
        ({"counts": [10**12]}, "counts of a mask must be runs of 12 pixels"),
        ({"counts": [2**62] * 4}, "runs of 12 pixels"),
        ({"counts": [-1, 13]}, "runs of 12 pixels"),
        ({"counts": [1.5, 10.5]}, "runs of 12 pixels"),
        ({"counts": [11]}, "runs of 12 pixels"),
    ],
)
def test_run_lengths_of_another_size_are_refused(change, message):
    record = rle_of_mask(np.eye(3, 4, dtype=bool)) | change
    with pytest.raises(ValueError, match=message):
        mask_of_rle(record, (3, 4))
