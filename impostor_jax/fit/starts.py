"""What the starts of a fit lead to.

Most images are explained by the first guess. Where one is not, the others race on the
few readings that speak for all, and those that may lead to a better end, or another,
are fitted to all readings.
"""

__all__ = ["Search", "guesses_of", "leaves_no_doubt"]

import dataclasses
import itertools
from collections.abc import Sequence
from functools import partial

import jax
import numpy as np

from impostor_jax.effort import Effort
from impostor_jax.fit.assess import Assessment
from impostor_jax.fit.body import AbstractBody
from impostor_jax.fit.fittable import Fittable
from impostor_jax.fit.program import Program
from impostor_jax.fit.race import MOST_STARTS, worth_a_fit
from impostor_jax.fit.regions import typical_sigma
from impostor_jax.fit.result import Fit
from impostor_jax.fit.seen import Seen
from impostor_jax.fit.weighing import likeliest
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.primitives.base import AbstractPrimitive

MOST_AT_ONCE = 65536
"""Readings above which no start is fitted to all of them before it is known where it
leads on a few."""

LIKELY = 0.3
"""Probability of residuals as large from which a fit from a given start stands: it
takes a third of the time."""

MOST_BETTER = 3
"""Times that a fit from a given start goes on to a better one."""

CLOSES = 3.0
"""Nats by which an image must be likelier without a bore that it does not show, for
that to be taken away: less than a reading of a lid costs, more than steps leave. Where
the fit with it did not converge it may be as much less likely. And by which one beside
a given start must be likelier to be taken."""


@dataclasses.dataclass
class Search:
    """For the best end of all starts.

    Attributes:
        kind: What is fitted.
        effort: How much work it takes.
        program: Fits all readings from a start, or a few from several.
        counts: Readings of the object in each of its images.
        found: What starts led to.
        num_starts: How many were tried.
    """

    kind: Fittable
    effort: Effort
    program: Program
    counts: Sequence[int]
    found: list[Assessment] = dataclasses.field(default_factory=list)
    num_starts: int = 0

    @property
    def num_readings(self) -> int:
        """Of the object in all images."""
        return sum(self.counts)

    def run(
        self,
        guesses: Sequence[list[AbstractBody]],
        initial: AbstractPrimitive | None,
        known: Fit | None,
    ) -> None:
        """Search from the start that is given, or from guesses, if there are any.

        Args:
            guesses: Of each image, as `guesses_of` returns them; none beside a start.
            initial: In the world frame.
            known: A fit of the same pixels, or of more.
        """
        effort, body = self.effort, self.kind.body
        moves = [table.camera_from_world for table in self.program.inputs.tables]
        if initial is not None:
            self.fit(_placed(body, initial, moves[0]))
            if effort.doubts:
                self.look_beside()
            self.closed()
            return
        starts = _in_order(guesses, moves, self.counts)[: effort.starts]
        if not starts:
            return
        if known is not None and leaves_no_doubt(known):
            # Of other pixels beside these, it may be off; the best guess is not.
            self.race([_placed(body, known.shape, moves[0]), starts[0]])
            self.closed()
            return
        if self.num_readings > MOST_AT_ONCE:
            self.race(starts)
        else:
            self.fit(starts[0])
        if effort.all_starts or not any(bool(one.is_clear) for one in self.found):
            self.race(starts[self.num_starts :])
            # Noise may hide which of two tilts is the true one.
            if effort.starts > 1 and any(bool(one.hides_tilt) for one in self.found):
                self.race([_mirrored(start) for start in starts])
        self.closed()
        if effort.doubts:
            self.doubt()

    def doubt(self) -> None:
        """Look where another solution may be, beside the best."""
        best, is_alone = likeliest(self.found), self.num_starts == 1
        if is_alone and not (bool(best.hides_turn) or bool(best.ends_early)):
            return
        bodies = [best.body]
        # And which of a short one's sides its axis is along.
        if self.effort.starts > 1 and bool(best.hides_turn):
            self.fit(_turned(best.body))
            bodies.append(self.found[-1].body)
        if not is_alone:
            # A guess that leads to one tilt may be too far off, mirrored, for the
            # other.
            self.race([_mirrored(body) for body in bodies])
        # Where noise is deep, or an end shows little, a fit may end where readings that
        # it leaves out would not let it, 10 standard deviations off; its first stages
        # lead on from there.
        if not is_alone or any(bool(one.ends_early) for one in self.found):
            self.fit(likeliest(self.found).body)

    def fit(self, start: AbstractBody) -> None:
        """Fit all readings from a start."""
        self.found.append(self.program.fit(start))
        self.num_starts += 1

    def race(self, starts: Sequence[AbstractBody]) -> None:
        """Fit those of some starts that may lead to a better end, or another."""
        for at in range(0, len(starts), MOST_STARTS - 1):
            self._race(starts[at : at + MOST_STARTS - 1])

    def _race(self, starts: Sequence[AbstractBody]) -> None:
        best = likeliest(self.found) if self.found else None
        if best is not None and not bool(best.fit.success):
            # It is not where it led: what ends there has to be fitted.
            best = None
        first = [] if best is None else [best.body]
        ends = self.program.race([*first, *starts])
        repeats = 1.0 if best is None else float(best.repeats)
        for k, count in worth_a_fit(ends, self.num_readings, repeats).items():
            if best is not None and k == 0:
                place = next(i for i, one in enumerate(self.found) if one is best)
                num_ended = int(best.num_ended) + count - 1
                self.found[place] = best._replace(num_ended=num_ended)
                continue
            end = jax.tree.map(lambda values, k=k: values[k], ends.body)
            both = [self.program.fit(end)]
            if self.effort.doubts and count == 1:
                # From where it began, too: all readings may lead a start elsewhere than
                # the few, which are not always the ones misled. Where several starts
                # end in one place, they are not.
                both.append(self.program.fit(starts[k - len(first)]))
            better = likeliest(both)
            self.found.extend(one for one in both if one is not better)
            self.found.append(better._replace(num_ended=count))
        self.num_starts += len(starts)

    def look_beside(self) -> None:
        """Go on from the fit there is, or from its mirror image, if that is better.

        What is seen from the side hides to which its axis leans, and pixels of a cap
        are outliers where an end is a pixel off: of 530 fits that began 2 mm and 1
        degree beside the truth 4 were up to 19 deviations wrong.
        """
        for _ in range(MOST_BETTER):
            (first,) = self.found
            if first.fit.tail.item() > LIKELY:
                break
            for start in (first.body, _mirrored(first.body)):
                self.fit(start)
            best = likeliest(self.found)
            is_better = float(best.cost) < float(first.cost) - CLOSES
            # Where both are as likely the caller has chosen.
            self.found, self.num_starts = [best if is_better else first], 1
            if not is_better:
                break

    def closed(self) -> None:
        """Fit without a bore where the best of a tube shows none.

        Readings of a lid are outliers in a bore; and where few are, an estimate may go
        to and fro between them for ever. It takes the place of all that explain no
        more.
        """
        best = likeliest(self.found)
        if self.kind.closed is None or np.isfinite(best.fit.std.inner_radius):
            return
        other = self.program.fit(_closed(self.kind.closed, best.body))
        is_better = bool(other.fit.success) and not bool(best.fit.success)
        if float(other.cost) > float(best.cost) + (CLOSES if is_better else -CLOSES):
            return
        better = [one for one in self.found if float(one.cost) > float(other.cost)]
        self.found = [*better, other]


def leaves_no_doubt(fit: Fit) -> bool:
    """Whether a fit knows of no other solution."""
    return bool(fit.success) and not np.any(np.asarray(fit.alternatives.weight))


def guesses_of(kind: Fittable, seen: Sequence[Seen]) -> list[list[AbstractBody]]:
    """First guesses of an object in the frame of each of its cameras."""
    return [
        kind.guesses(
            one.image,
            one.region,
            one.camera,
            typical_sigma(one.image, one.region, one.noise),
        )
        for one in seen
    ]


def _in_order(
    guesses: Sequence[list[AbstractBody]],
    moves: Sequence[RigidTransform],
    counts: Sequence[int],
) -> list[AbstractBody]:
    """First guesses in the first view's frame: the best of each view, then the others.

    Views with more readings come first.
    """
    found = []
    for bodies, move, count in zip(guesses, moves, counts, strict=True):
        if move is not moves[0]:
            bodies = [_moved(body, move, moves[0]) for body in bodies]
        found.append((count, bodies))
    found.sort(key=lambda pair: -pair[0])
    ranks = itertools.zip_longest(*(bodies for _, bodies in found))
    return [body for rank in ranks for body in rank if body is not None]


@partial(jax.jit, static_argnums=0)
def _placed(
    body: type[AbstractBody], shape: AbstractPrimitive, move: RigidTransform
) -> AbstractBody:
    """In one program: operation by operation it takes a millisecond."""
    return body.of(shape).transformed(move)


@jax.jit
def _moved(
    body: AbstractBody, source: RigidTransform, target: RigidTransform
) -> AbstractBody:
    """A body of one camera's frame in that of another."""
    return body.transformed(source.inverse()).transformed(target)


_closed = partial(jax.jit, static_argnums=0)(lambda close, body: close(body))
_mirrored = jax.jit(lambda body: body.mirrored())
_turned = jax.jit(lambda body: body.turned())
