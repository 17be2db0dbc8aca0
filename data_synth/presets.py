"""The presets, by name."""

__all__ = ["BANDED", "PRESETS", "preset_named"]

from pathlib import Path
from typing import Any

from data_synth.appearance import Appearance
from data_synth.camera_draw import CameraDraw, ScannerDraw
from data_synth.distribution import Choice, Fixed, LogUniform, Uniform, Whole
from data_synth.preset import Preset, Rules
from data_synth.roughness import Roughness
from data_synth.scenery import (
    Arms,
    Bags,
    Balls,
    Books,
    Bottles,
    Boxes,
    Bumps,
    Cones,
    Corners,
    Hands,
    Mounds,
    Pillars,
    Rolls,
)
from impostor_jax.io.json_file import read_json_object
from impostor_jax.sensor.correlated import CorrelatedNoise
from impostor_jax.sensor.dropout import Dropout
from impostor_jax.sensor.flying_pixels import FlyingPixels
from impostor_jax.sensor.gaussian import ConstantNoise
from impostor_jax.sensor.lateral import LateralNoise
from impostor_jax.sensor.matching_window import MatchingWindow
from impostor_jax.sensor.quantization import StereoDisparity
from impostor_jax.sensor.structured_light import StructuredLight
from impostor_jax.sensor.time_of_flight import TimeOfFlight

CUPS = Cones(
    count=Whole(0, 2),
    radius=LogUniform(0.03, 0.055),
    aspect=Uniform(1.5, 3.0),
    half_angle=Uniform(4.0, 12.0),
    inverted=0.5,
    lying=0.25,
)
CONES = Cones(
    count=Whole(0, 2),
    radius=LogUniform(0.03, 0.07),
    aspect=Uniform(1.0, 4.0),
    half_angle=Uniform(12.0, 40.0),
    inverted=0.1,
    lying=0.15,
)

BANDED = CorrelatedNoise(MatchingWindow(StructuredLight()), 0.001, 20.0)
"""What `StructuredLight.sensor` errs by, but for the scale: how far off a thing is from
where it is seen to be then tells of how it is found."""

TABLE: dict[str, Any] = {
    "distance": Uniform(0.7, 1.1),
    "elevation": Uniform(20.0, 60.0),
    "spread": 0.25,
    "ground": True,
    "wall": Uniform(1.8, 2.5),
    "camera": CameraDraw(focal=Uniform(500.0, 560.0), shift=Uniform(-8.0, 8.0)),
    "sensor": Dropout(FlyingPixels(StructuredLight())),
    "projector_baseline": 0.075,
    "touching": 0.25,
    "rules": Rules(visible_fraction=0.1),
}
"""Of the presets of things on a table: where it is, and what reads it."""

MIXED: dict[str, Any] = {
    "count": Whole(2, 5),
    "radius": LogUniform(0.025, 0.055),
    "aspect": Uniform(1.3, 4.0),
    "placement": ("standing", "lying", "stacked"),
    "scenery": (
        Boxes(count=Whole(0, 2), edge=LogUniform(0.04, 0.2)),
        Balls(count=Whole(0, 2), radius=LogUniform(0.02, 0.07)),
        CUPS,
        CONES,
    ),
    **TABLE,
}
"""Of the presets of cans among other things."""

PRESETS = {
    "bench": Preset(
        sentence="One can in any pose before a wall, read with white noise of 1 mm.",
        radius=LogUniform(0.02, 0.06),
        aspect=Uniform(2.0, 5.0),
        distance=Uniform(0.5, 1.2),
        spread=0.05,
        wall=Uniform(1.5, 2.0),
        rules=Rules(visible_fraction=0.9),
    ),
    "tabletop_cans": Preset(
        sentence="Two to six cans, standing and lying on a table before a wall, read "
        "by structured light with the projector's shadow, missing and flying pixels.",
        count=Whole(2, 6),
        radius=LogUniform(0.025, 0.055),
        aspect=Uniform(1.5, 4.5),
        placement=("standing", "standing", "lying"),
        **dict(TABLE, spread=0.2, touching=0.0),
    ),
    "pipes": Preset(
        sentence="One to four long pipes in any direction before a wall, most of them "
        "out of the frame at an end, with missing and flying pixels.",
        count=Whole(1, 4),
        radius=LogUniform(0.01, 0.06),
        aspect=LogUniform(15.0, 60.0),
        distance=Uniform(0.8, 2.0),
        spread=0.3,
        wall=Uniform(2.5, 3.5),
        sensor=Dropout(FlyingPixels(StructuredLight())),
        rules=Rules(visible_fraction=0.1),
    ),
    "tree_trunks": Preset(
        sentence="One to five trunks, upright to 8 degrees, on the ground before a "
        "stereo camera of 12 cm baseline.",
        count=Whole(1, 5),
        radius=LogUniform(0.08, 0.35),
        aspect=Uniform(12.0, 40.0),
        placement=("standing",),
        distance=Uniform(3.0, 6.0),
        elevation=Uniform(5.0, 20.0),
        spread=2.0,
        tilt=8.0,
        ground=True,
        wall=Fixed(15.0),
        sensor=FlyingPixels(StereoDisparity(525.0, baseline=0.12)),
        depth_scale_mm=1.0,
        rules=Rules(visible_fraction=0.05),
    ),
    "tree_scan": Preset(
        sentence="Stems 5 to 30 m around a laser scanner, upright to 6 degrees, with "
        "bark, on rough and rolling ground: ranges of a full turn with noise of 2 mm "
        "near and 20 mm far, missing readings and mixed ones at edges.",
        objects=40,
        count=Whole(12, 24),
        radius=LogUniform(0.05, 0.25),
        aspect=Uniform(40.0, 80.0),
        placement=("surrounding",),
        distance=Uniform(5.0, 30.0),
        tilt=6.0,
        ground=True,
        camera=ScannerDraw(stand=Uniform(1.5, 2.0)),
        sensor=Dropout(FlyingPixels(TimeOfFlight(floor=0.002, growth=2e-5)), rate=0.03),
        # Cracks of some millimeters, and what grows on the ground.
        roughness=Roughness(deviation=0.003, length=0.04),
        scenery=(
            Mounds(
                count=Whole(4, 10), height=Uniform(0.1, 0.6), width=Uniform(2.0, 8.0)
            ),
        ),
        depth_scale_mm=1.0,
        rules=Rules(visible_fraction=0.0, smallest_outline=0),
    ),
    "inside_pipe": Preset(
        sentence="The camera in a pipe, looking along it to 20 degrees, with noise of "
        "2 mm and missing readings where the view grazes the wall.",
        radius=LogUniform(0.1, 0.5),
        aspect=Uniform(12.0, 40.0),
        placement=("around",),
        tilt=20.0,
        camera=CameraDraw(focal=Uniform(280.0, 420.0)),
        sensor=Dropout(ConstantNoise(0.002)),
        depth_scale_mm=0.5,
        rules=Rules(visible_fraction=0.0, smallest_outline=5000),
    ),
    "hard": Preset(
        sentence="One to three cylinders, thin, far or seen end on, with up to three "
        "more before them, through a lens, with shadow, lateral noise and missing and "
        "flying pixels.",
        count=Whole(1, 3),
        clutter=Whole(0, 3),
        radius=LogUniform(0.008, 0.06),
        aspect=LogUniform(0.5, 20.0),
        distance=Uniform(0.6, 2.5),
        spread=0.15,
        wall=Choice((2.9, 3.5, 4.5)),
        camera=CameraDraw(
            count=4,
            focal=Uniform(450.0, 600.0),
            shift=Uniform(-10.0, 10.0),
            distortion=(Uniform(-0.1, 0.05), Uniform(-0.02, 0.02)),
        ),
        sensor=Dropout(FlyingPixels(LateralNoise(StructuredLight(), floor=0.5))),
        projector_baseline=0.075,
        rules=Rules(visible_fraction=0.05, smallest_outline=100),
    ),
    "mixed_table": Preset(
        sentence="Two to five cans on a table before a wall, standing, lying and on "
        "one another, among boxes, balls, cones and cups, a quarter of all put in "
        "contact, read as tabletop_cans.",
        **MIXED,
    ),
    "color_table": Preset(
        sentence="The scenes of mixed_table, each in color, too: of ten things two "
        "mirror and one is of glass, under two lamps.",
        appearance=Appearance(mirrors=0.2, glasses=0.1),
        **MIXED,
    ),
    "everyday_things": Preset(
        sentence="Up to three cans, standing and lying, some of them low, among what "
        "kitchens and workshops hold: bottles, jars, bags, towels, arms, hands, boxes "
        "and books, read by structured light whose readings lean at edges and have "
        "bands.",
        count=Whole(0, 3),
        radius=LogUniform(0.012, 0.1),
        aspect=LogUniform(0.6, 8.0),
        placement=("standing", "standing", "lying"),
        scenery=(
            Bottles(
                count=Whole(0, 2),
                radius=LogUniform(0.025, 0.06),
                aspect=Uniform(2.5, 6.0),
                waist=Uniform(-0.25, 0.3),
                neck=Uniform(0.25, 0.7),
                shoulder=Uniform(0.2, 0.6),
                lying=0.3,
            ),
            Arms(
                count=Whole(0, 1),
                length=Uniform(0.18, 0.3),
                radius=Uniform(0.025, 0.05),
                taper=Uniform(0.5, 0.8),
                swell=Uniform(0.0, 0.15),
                bend=Uniform(0.0, 0.06),
            ),
            Hands(count=Whole(0, 1), length=Uniform(0.15, 0.2)),
            Bags(
                count=Whole(0, 1),
                size=LogUniform(0.03, 0.09),
                lump=Uniform(0.3, 0.7),
            ),
            Rolls(
                count=Whole(0, 1),
                length=Uniform(0.12, 0.3),
                radius=LogUniform(0.02, 0.06),
                unevenness=Uniform(0.04, 0.2),
                wave=Uniform(0.7, 2.5),
            ),
            Boxes(count=Whole(0, 2), edge=LogUniform(0.04, 0.2)),
            Books(
                count=Whole(0, 1),
                length=Uniform(0.15, 0.25),
                thickness=Uniform(0.01, 0.04),
                leaning=0.3,
                tilt=Uniform(8.0, 35.0),
            ),
            Balls(count=Whole(0, 1), radius=LogUniform(0.02, 0.07)),
            CUPS,
        ),
        **dict(TABLE, sensor=Dropout(BANDED)),
    ),
    "no_cylinders": Preset(
        sentence="No cylinder: boxes, books, balls, cones, cups, hands and bumps on a "
        "table before the edges and corners of a room, read as tabletop_cans.",
        objects=0,
        count=Fixed(0),
        scenery=(
            Corners(count=Whole(0, 1), beyond=Uniform(0.6, 1.1)),
            Pillars(
                count=Whole(0, 1),
                width=Uniform(0.15, 0.4),
                height=Uniform(0.3, 0.8),
                beyond=Uniform(0.25, 0.5),
            ),
            Hands(count=Whole(0, 1), length=Uniform(0.15, 0.2)),
            Bumps(
                count=Whole(0, 2),
                width=LogUniform(0.015, 0.05),
                stretch=Uniform(0.0, 2.0),
                part=Uniform(0.4, 1.2),
            ),
            Boxes(count=Whole(1, 3), edge=LogUniform(0.04, 0.2)),
            Books(
                count=Whole(0, 2),
                length=Uniform(0.15, 0.25),
                thickness=Uniform(0.01, 0.04),
                leaning=0.5,
                tilt=Uniform(8.0, 35.0),
            ),
            Balls(count=Whole(0, 2), radius=LogUniform(0.02, 0.07)),
            CUPS,
            CONES,
        ),
        **TABLE,
    ),
}
"""By the name that a command takes."""


def preset_named(name: str) -> Preset:
    """The preset of a name, or of a JSON file that holds its record.

    Raises:
        ValueError: There is none, or the file is not readable.
    """
    if name in PRESETS:
        return PRESETS[name]
    if not name.endswith(".json"):
        raise ValueError(
            f"preset must be one of {', '.join(PRESETS)} or a .json file, got {name!r}"
        )
    return Preset.from_record(read_json_object(Path(name), f"preset {name!r}"))
