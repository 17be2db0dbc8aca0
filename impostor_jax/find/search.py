"""The search: propose walls, weigh them, fit the likeliest, take its pixels, go on."""

__all__ = ["Detection", "Request", "Searched", "search"]

import dataclasses
import itertools
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from impostor_jax.find.bulge import bulging
from impostor_jax.find.caps import NO_CAPS, Caps, caps_of, doming, inner_of
from impostor_jax.find.confidence import Observed, confidence, facts_of
from impostor_jax.find.continuation import continuation
from impostor_jax.find.deformation import (
    Deformation,
    Wall,
    bending,
    deformation,
    wall_readings,
)
from impostor_jax.find.evidence import Candidate, Evidence, Scene, shown, weighed
from impostor_jax.find.fitting import Fitter
from impostor_jax.find.normals import STEEPEST, normals_of, stray
from impostor_jax.find.objects import creases, numbered, objects_of
from impostor_jax.find.patches import Part, proposed
from impostor_jax.find.planes import PlaneRegions, planes_of
from impostor_jax.find.rivals import rivals
from impostor_jax.find.view import View
from impostor_jax.fit.regions import SQUARE
from impostor_jax.fit.result import DISAGREEING, Fit
from impostor_jax.fit.status import FitStatus
from impostor_jax.opencv import cv2

MOST_TURNS = 3
"""How often the rest of the image is looked at again."""

LEVELS = (4, 9)
"""Numbers of patches that an object is cut into."""

KEPT = 5
"""Walls of an object that are weighed."""

LEAST_CHANCE = 0.2
"""Of the confidence that is asked for: chance of being right, as far as it is known
without a fit, of what is fitted."""

LEAST_BENT = 2.0
"""Standard deviations by which a wall must be bent that is not seen from outline to
outline: on what is flat a fit goes to a radius of many meters, slowly."""

WIDE_ARC = 1.6
"""Angle over which a wall is seen, in radians, from which its outlines tell its radius:
of a thin one more than its bend."""

CHANGED = (0.03, 0.1, 0.1)
"""Part of a mask from whose change on it is fitted again, for the first time, for the
second, and so on."""

MOST_REFUSED = 100
"""Candidates in a row that turn out to be none, after which a search ends: of tables
with many things 18 were refused before one was found. Where a third of all readings
were a number that stood for none 1300 were fitted, in a minute."""

MOST_MISFIT = 3.0
"""Mean square of the deviations of what a cylinder explains, at most."""

SURE = 0.9
"""Confidence before a fit from which noise that was measured may be wrong, where the
fit leaves more than that."""

MOST_BULGING = 0.1
"""Part of a wall that stands out of it, at most: of boxes it was 0.3 to 0.5, of cans
that something touches 0.03."""

MOST_OPEN = 0.1
"""Standard deviation of the radius of a wall that departs, over the radius, at most."""

FEW = 2000
"""Pixels up to which no quick fit tries a candidate: it would know too little."""

END_ON = 0.95
"""Cosine of the angle between a view and an axis from which it is seen end on."""

LEAST_WALL = 1.5
"""Pixels across what is seen of such a wall, at least."""

MOST_BESIDE = 3.0
"""Pixels of an object that is seen end on, over those of its cap, at most."""

FEW_OF_WALL = 100
"""Readings of a wall up to which it is fitted before it is compared with its rivals: a
radius that is 10 % off picks those that a cone explains best."""


@dataclasses.dataclass(frozen=True)
class Request:
    """What is looked for.

    Attributes:
        min_pixels: Fewest pixels of a cylinder, in the image.
        min_arc: Smallest angle around its axis that is seen of it, in radians.
        radius_range: Smallest and largest radius, in meters.
        least_sure: Confidence of what is found: it is likelier than not.
    """

    min_pixels: int = 150
    min_arc: float = 0.6
    radius_range: tuple[float, float] = (0.003, 1.0)
    least_sure: float = 0.5


class Entry(NamedTuple):
    """A candidate with all that is known of it before a fit."""

    evidence: Evidence
    caps: Caps
    readings: Wall | None
    shape: Deformation | None
    chance: float

    @property
    def gain(self) -> float:
        """Pixels that speak for it less those against it, times its chance."""
        evidence = self.evidence
        against = 2 * evidence.behind + evidence.other
        return self.chance * (evidence.explained + self.caps.size - against)


class Detection(NamedTuple):
    """A cylinder that was found.

    Attributes:
        fit: Of it.
        entry: What speaks for it.
        facts: Those that its confidence is made of.
        mask: Pixels of the image that show it.
        confidence: Probability that it is there.
    """

    fit: Fit
    entry: Entry
    facts: Float[np.ndarray, " f"]
    mask: Bool[np.ndarray, "H W"]
    confidence: float


class Searched(NamedTuple):
    """What was found, and the planes that were taken away before."""

    detections: list[Detection]
    planes: PlaneRegions


def search(view: View, request: Request, fitter: Fitter) -> Searched:
    """Search a view.

    Args:
        view: Of the image.
        request: What is looked for.
        fitter: Fits what is likely.
    """
    state = _Search(view, request, fitter)
    for _ in range(MOST_TURNS):
        if not state.took_another():
            break
    return Searched(state.detections, state.planes)


class _Search:
    """The state of a search: what is free, and what was found."""

    def __init__(self, view: View, request: Request, fitter: Fitter):
        self.view, self.request, self.fitter = view, request, fitter
        self.usable = view.valid & ~stray(view)
        self.normals = normals_of(view, self.usable)
        self.planes = planes_of(view, self.usable)
        self.least_chance = LEAST_CHANCE * request.least_sure
        self.fewest = max(20, request.min_pixels // view.stride**2)
        self.free = self.usable & (self.planes.labels == 0)
        self.joined: Int[np.ndarray, "h w"] | None = None
        self.crease = creases(view, self.normals)
        self.agrees = fitter.agrees(view)
        self.detections: list[Detection] = []
        self.looked_at: set[tuple[int, int]] = set()
        self.refused: list[Candidate] = []

    def scene(self) -> Scene:
        """What candidates are compared with now."""
        return Scene(
            self.view, self.normals, self.planes.noise, self.usable, self.free,
            self.planes.labels > 0, self.planes.shared,
        )  # fmt: skip

    def took_another(self) -> bool:
        """Go once through what is free; whether anything was found."""
        before = len(self.detections)
        parts = self._parts()
        walls = self._proposals(parts)
        walls += self._guesses(parts, walls)
        scene = self.scene()
        queue = [entry for wall in walls for entry in self._entries(scene, wall)]
        num_refused = 0
        while queue and num_refused < MOST_REFUSED:
            best = queue.pop(int(np.argmax([entry.gain for entry in queue])))
            if not (best.gain > 0 and best.chance >= self.least_chance):
                break
            wall = best.evidence.wall
            if self._found(wall) or any(alike(wall, one) for one in self.refused):
                continue
            if not self.free.ravel()[best.evidence.pixels].all():
                # Something has taken pixels since.
                queue += self._entries(scene, wall)
                continue
            found, others = self._fitted(scene, best)
            if found:
                scene, num_refused = self.scene(), 0
            else:
                self.refused.append(wall)
                num_refused += 1
            queue += others
        return len(self.detections) > before

    def _parts(self) -> list[Part]:
        """Objects, and what creases cut them into, that have not been looked at."""
        noise, half = self.planes.noise, self.fewest // 2
        labels = objects_of(self.view, self.free, noise, half)
        wholes = _pixels_of(labels)
        pieces = _pixels_of(numbered((labels > 0) & ~self.crease, half))
        flat = labels.ravel()
        parts = [Part(pixels, LEVELS) for pixels in wholes]
        parts += [
            Part(pixels, LEVELS[:1])
            for pixels in pieces
            if len(pixels) < 0.9 * len(wholes[flat[pixels[0]] - 1])
        ]
        # Nothing has changed where pixels and place of a part are the same.
        new = [p for p in parts if (p.pixels[0], len(p.pixels)) not in self.looked_at]
        self.looked_at |= {(p.pixels[0], len(p.pixels)) for p in new}
        return new

    def _proposals(self, parts: list[Part]) -> list[Candidate]:
        """The best walls of each part's patches."""
        found: list[Candidate] = []
        all_walls = proposed(
            self.view, self.normals, self.planes.noise, parts,
            self.request.radius_range, self.fewest // 3,
        )  # fmt: skip
        for part, some in zip(parts, all_walls, strict=True):
            score = some.score.ravel() * len(part.pixels)
            fields = [np.asarray(x).reshape(len(score), -1) for x in some.wall]
            kept: list[Candidate] = []
            for k in np.argsort(-score, kind="stable"):
                if len(kept) == KEPT or not score[k] >= self.fewest / 3:
                    break
                center, axis, log_radius, side = (x[k].astype(float) for x in fields)
                wall = Candidate(
                    center, axis, float(np.exp(log_radius[0])), float(side[0])
                )
                if not any(alike(wall, other) for other in [*kept, *found]):
                    kept.append(wall)
            found += kept
        return found

    def _guesses(self, parts: list[Part], known: list[Candidate]) -> list[Candidate]:
        """First guesses of fits, which know caps that are seen end on."""
        low, high = self.request.radius_range
        found: list[Candidate] = []
        for part in parts:
            region = np.zeros(self.view.depth.shape, bool)
            region.ravel()[part.pixels] = True
            guesses = self.fitter.guesses(self._of_image(region))
            if guesses and self._is_end_on(guesses[0]):
                # Proposals that are alike are rough beside it.
                moved = self._moved_to(part, guesses[0])
                found += [wall for wall in moved if low < wall.radius < high]
            for wall in guesses:
                if low < wall.radius < high and not any(
                    alike(wall, other) for other in [*known, *found]
                ):
                    found.append(wall)
        return found

    def _entry(self, scene: Scene, wall: Candidate) -> Entry | None:
        """All that is known of a candidate; None where too little speaks for it."""
        evidence = weighed(scene, wall)
        if evidence is None:
            return None
        caps = caps_of(scene, evidence)
        if caps.rim and caps.misfit > MOST_MISFIT:
            # It is no disc: the wall goes on as a neck or a dome.
            caps = NO_CAPS
        seen = evidence.explained + caps.size
        if seen < self.fewest / 2 or max(evidence.arc, caps.rim) < self.request.min_arc:
            return None
        if caps.misfit_with(evidence) > MOST_MISFIT:
            return None
        if evidence.explained < evidence.behind + evidence.other:
            return None
        readings = wall_readings(scene, evidence)
        axis, shared = evidence.wall.axis, scene.shared
        is_part = evidence.arc < WIDE_ARC and not caps.rim
        if is_part and readings and bending(axis, readings, shared) < LEAST_BENT:
            return None
        shape = readings and deformation(axis, readings, shared)
        if (shape is None or shape.vague > 1) and caps.rim < np.pi / 2:
            return None
        if shape is not None and np.any(
            np.abs(shape.value) > 0.3 + 3 * shape.deviation
        ):
            return None
        known = Observed(evidence, caps, shape, shared=shared)
        chance = confidence(facts_of(known))
        return Entry(evidence, caps, readings, shape, chance)

    def _found(self, wall: Candidate) -> bool:
        return any(alike(wall, one.entry.evidence.wall) for one in self.detections)

    def _entries(self, scene: Scene, wall: Candidate, cuts: int = 2) -> list[Entry]:
        """What is known of a candidate, or of those that it was taken for.

        Args:
            scene: What it is compared with.
            wall: The candidate.
            cuts: How often it may be cut.
        """
        entry = self._entry(scene, wall)
        if entry is None:
            return []
        halves = self._halves(scene, entry, cuts)
        return [entry] if halves is None else halves

    def _halves(self, scene: Scene, entry: Entry, cuts: int) -> list[Entry] | None:
        """The cylinders that meet where one was taken for both; None for one."""
        if entry.shape is None or entry.shape.seam is None or not cuts:
            return None
        wall, seam = entry.evidence.wall, entry.shape.seam
        low, high = wall.limits
        return [
            half
            for limits in ((low, seam), (seam, high))
            for half in self._entries(scene, wall._replace(limits=limits), cuts - 1)
        ]

    def _fitted(self, scene: Scene, entry: Entry) -> tuple[bool, list[Entry]]:
        """Fit a candidate, and keep it if it is sure enough.

        Returns:
            Whether it was kept, and candidates that its fit leads to.
        """
        readings = entry.readings
        if readings is None or len(readings.pixels) > FEW_OF_WALL:
            chance = confidence(facts_of(_observed(scene, entry)))
            if not chance >= self.least_chance:
                return False, []
        mask = self._mask(scene, entry) | self._seen_end_on(entry)
        # Most of what is fitted is refused: of many pixels a quick fit tells enough.
        is_quick, fitter = np.count_nonzero(mask) > FEW, self.fitter
        fitted = fitter.tried if is_quick else fitter.fit
        fit = fitted(self._of_image(mask), entry.evidence)
        if is_quick and _ends_early(fit):
            fit = fitter.fit(self._of_image(mask), entry.evidence)
            is_quick = False
        is_poor = fit.status is FitStatus.POOR_FIT and bool(fit.chi2 > MOST_MISFIT)
        if is_poor and fitter.is_measured and entry.chance > SURE:
            # What a filter leaves of the noise of planes, where most is measured, is
            # less than of a wall's.
            fitter = fitter.by_itself
            fit = fitter.fit(self._of_image(mask), entry.evidence)
            is_quick = False
        final = self._led_to(scene, fit, entry)
        if final is None or self._found(final.evidence.wall):
            return False, []
        halves = self._halves(scene, final, 2)
        if halves is not None:
            return False, halves
        changes = iter((*CHANGED, np.inf))
        while True:
            before, mask = mask, self._mask(scene, final)
            facts = self._facts_of_fit(scene, final, fit)
            if not confidence(facts) >= self.least_chance:
                return False, []
            most = next(changes) * np.count_nonzero(mask)
            changed = np.count_nonzero(mask ^ before) > most
            if not (changed or (is_quick and fitter.options.effort.doubts)):
                break
            # The fit knows better than what it began with what shows it.
            again = fitter.fit(self._of_image(mask), final.evidence)
            better = self._led_to(scene, again, final)
            if better is None and is_quick:
                return False, []
            if better is None:
                break
            fit, final, is_quick = again, better, False
        sure = confidence(facts)
        # What is no number is not sure.
        if not sure >= self.request.least_sure:
            return False, []
        if bulging(scene, final.evidence) > MOST_BULGING:
            return False, []
        fit, final, shows = self._with_ends(scene, fit, final, self._of_image(mask))
        self.detections.append(Detection(fit, final, facts, shows, sure))
        taken = cv2.dilate(mask.view(np.uint8), SQUARE) > 0
        self.free, self.joined = self.free & ~taken, None
        return True, []

    def _with_ends(
        self, scene: Scene, fit: Fit, entry: Entry, mask: Bool[np.ndarray, "H W"]
    ) -> tuple[Fit, Entry, Bool[np.ndarray, "H W"]]:
        """A fit, what is known of it, and its mask, up to ends that this lacks.

        Args:
            scene: What is searched.
            fit: Of a wall.
            entry: What speaks for it.
            mask: Pixels of the image that show it.
        """
        whole = self.fitter.up_to_ends(mask, fit)
        if whole is None:
            return fit, entry, mask
        again = self.fitter.fit(whole, entry.evidence)
        better = self._led_to(scene, again, entry)
        counts = [np.count_nonzero(one.ends_seen) for one in (again, fit)]
        if better is None or counts[0] <= counts[1]:
            return fit, entry, mask
        return again, better, whole

    def _led_to(self, scene: Scene, fit: Fit, entry: Entry) -> Entry | None:
        """What is known of the wall that a fit of a candidate found; None for none."""
        if not bool(fit.success):
            return None
        wall = self.fitter.wall_of(fit, entry.evidence.wall)
        if self._is_end_on(wall) and self._shows_no_wall(fit, wall):
            return None
        led = self._entry(scene, wall)
        # The rim of a cap that was not fitted yet tells the radius.
        is_told = led is not None and led.caps.rim > np.pi and not entry.caps.rim
        return None if _is_no_cylinder(fit) and not is_told else led

    def _shows_no_wall(self, fit: Fit, wall: Candidate) -> bool:
        """Whether a cap is all that is seen, as of a cup from above, or no disc."""
        aside = np.linalg.norm(np.cross(self._view_of(wall), wall.axis))
        across = float(aside * fit.cylinder.height)
        width = float(self.view.width(max(wall.center[2], 0.0)))
        return across < LEAST_WALL * width or bool(fit.form.departs)

    def _facts_of_fit(
        self, scene: Scene, entry: Entry, fit: Fit
    ) -> Float[np.ndarray, " f"]:
        """All facts of a candidate that was fitted."""
        wall = entry.evidence.wall
        noise = self.planes.noise if self.fitter.is_trusted else self._noise_at(wall)
        return facts_of(_observed(scene, entry), fit, noise)

    def _noise_at(self, wall: Candidate) -> float | None:
        """Factor of a sigma that nobody told, where a cylinder about the same axis is.

        What its lid or its neck is read by is read by the same errors. None elsewhere.
        """
        about = [
            float(one.fit.chi2)
            for one in self.detections
            if is_coaxial(wall, one.entry.evidence.wall)
        ]
        return max(about[0], 1.0) ** 0.5 if about else None

    def _of_image(self, mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "H W"]:
        return self.fitter.of_image(self.view, mask) & self.agrees

    def _moved_to(self, part: Part, guess: Candidate) -> list[Candidate]:
        """A guess that is seen end on, fitted to its object; none where that fails.

        Its wall grazes the view: a radius that is a hundredth off misses that by more
        than good sensors err.
        """
        own = self._object_of(part.pixels)
        count, least = np.count_nonzero(own), len(part.pixels)
        if not least <= count <= MOST_BESIDE * least:
            return []
        fit = self.fitter.guessed(self._of_image(own))
        return [self.fitter.wall_of(fit, guess)] if bool(fit.success) else []

    def _seen_end_on(self, entry: Entry) -> Bool[np.ndarray, "h w"]:
        """What is left of an object of which a cap shows most; nothing of others.

        Of a disc alone no fit knows how it goes on.
        """
        caps, none = entry.caps, np.zeros(self.free.shape, bool)
        if not (caps.rim > np.pi and self._is_end_on(entry.evidence.wall)):
            return none
        own = self._object_of(caps.pixels)
        return own if np.count_nonzero(own) < MOST_BESIDE * caps.size else none

    def _is_end_on(self, wall: Candidate) -> bool:
        """Whether the view is nearly along an axis."""
        return bool(abs(self._view_of(wall) @ wall.axis) > END_ON)

    def _view_of(self, wall: Candidate) -> Float[np.ndarray, "3"]:
        """Unit vector of the ray to its middle."""
        if self.view.is_central:
            return wall.center / max(np.linalg.norm(wall.center), 1e-12)
        return np.array([0.0, 0.0, 1.0])

    def _object_of(self, pixels: Int[np.ndarray, " n"]) -> Bool[np.ndarray, "h w"]:
        """What hangs together with most of some pixels, though it grazes the view."""
        if self.joined is None:
            # Of all that is free, until something is taken.
            noise = self.planes.noise
            self.joined = objects_of(self.view, self.free, noise, self.fewest, STEEPEST)
        label = np.bincount(self.joined.ravel()[pixels]).argmax()
        return (self.joined == label) & (label > 0)

    def _mask(self, scene: Scene, entry: Entry) -> Bool[np.ndarray, "h w"]:
        own = self.free | (self.view.valid & ~self.usable)
        mask = shown(scene, entry.evidence, own, self.fitter.mixes)
        mask.ravel()[entry.caps.pixels] = True
        return mask


def _observed(scene: Scene, entry: Entry) -> Observed:
    """What is known of a candidate without a fit: its rivals and surroundings, too."""
    evidence, caps, readings = entry.evidence, entry.caps, entry.readings
    inner = inner_of(scene, evidence, caps)
    return Observed(
        evidence,
        caps,
        entry.shape,
        readings and rivals(scene, evidence, readings, inner),
        continuation(scene, evidence),
        doming(evidence, inner, scene.shared),
        scene.shared,
    )


def _is_no_cylinder(fit: Fit) -> bool:
    """Whether a wall departs so far that it has no radius, as part of a neck does."""
    is_open = fit.std.radius > MOST_OPEN * fit.cylinder.radius
    return bool(fit.form.departs & is_open)


def _ends_early(fit: Fit) -> bool:
    """Whether a quick fit fails though most of its region agrees with it.

    At the border are a neck, or another thing beside it, which a fit that has doubts
    leaves out. And one may take more steps: two of twelve cans in depth that is rounded
    to a millimeter, over noise of a third, were not found.
    """
    if not bool(fit.chi2 < MOST_MISFIT):
        return False
    is_refuted = fit.status is FitStatus.POOR_FIT
    is_refuted = is_refuted and bool(fit.border_chi2 >= DISAGREEING)
    return is_refuted or fit.status is FitStatus.STEP_LIMIT


def alike(one: Candidate, other: Candidate) -> bool:
    """Whether two walls are so near that they lead to the same fit.

    What stands on something is nearer to its wall than that, so walls that may be at
    other places along the axis are the same only where they agree closely.
    """
    loose = one.limits == other.limits
    if one.side != other.side:
        return False
    if abs(np.log(one.radius / other.radius)) > (0.15 if loose else 0.03):
        return False
    return is_coaxial(one, other, *((8.0, 0.2) if loose else (2.0, 0.08)))


def is_coaxial(
    one: Candidate, other: Candidate, degrees: float = 8.0, aside: float = 0.2
) -> bool:
    """Whether two walls have the same axis, but for an angle and a part of a radius."""
    if abs(one.axis @ other.axis) < np.cos(np.radians(degrees)):
        return False
    off = other.center - one.center
    off = off - (off @ one.axis) * one.axis
    return bool(np.linalg.norm(off) < aside * one.radius)


def _pixels_of(labels: Int[np.ndarray, "h w"]) -> list[Int[np.ndarray, " n"]]:
    """Flat indices of the pixels of each label from 1."""
    flat = labels.ravel()
    order = np.argsort(flat, kind="stable")
    bounds = np.searchsorted(flat[order], np.arange(1, flat.max(initial=0) + 2))
    return [order[a:b] for a, b in itertools.pairwise(bounds)]
