"""An image in blocks, and the shapes that each can show."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from impostor_jax.rendering.blocks import Rectangles, Tiling, pairs_of, sorted_pairs

TILING = Tiling(3, 4)


@pytest.mark.parametrize("shape", [(6, 8), (7, 9), (2, 3)])
def test_blocks_of_an_image_make_it_again(shape):
    image = jnp.arange(shape[0] * shape[1]).reshape(shape)
    blocks = TILING.cut(image)
    assert blocks.shape == (-(-shape[0] // 3) * -(-shape[1] // 4), 12)
    np.testing.assert_array_equal(TILING.joined(blocks, *shape), image)
    # Row by row; beyond the image its last pixels stand once more.
    first = np.pad(image, ((0, 3), (0, 4)), mode="edge")[:3, :4]
    np.testing.assert_array_equal(blocks[0], first.ravel())


def test_pairs_are_the_blocks_of_every_rectangle():
    # Of 4 x 5 blocks; the second shape is not seen.
    fields = (1, 0, 0, 2), (2, 0, 4, 1), (0, 3, 2, 4), (3, 0, 2, 1)
    rectangles = Rectangles(*(jnp.array(field, jnp.int32) for field in fields))
    ending = jnp.cumsum(rectangles.count)
    line, across = jnp.zeros(4), jnp.zeros(5)
    extent = (line, line), (across, across)
    pairs_from = jax.jit(lambda k: pairs_of(rectangles, ending, k, 8, extent))
    found = []
    for first in (0, 8):
        pairs = jax.tree.map(np.asarray, pairs_from(jnp.int32(first)))
        assert sorted(pairs.order) == list(range(20))
        assert (np.diff(pairs.count[pairs.order]) <= 0).all()
        for block in range(20):
            start = pairs.first[block]
            shapes = pairs.shape[start : start + pairs.count[block]]
            found += [(shape, *divmod(block, 5)) for shape in shapes]
    expected = [
        (shape, row + i, col + j)
        for shape, (row, rows, col, cols) in enumerate(zip(*fields, strict=True))
        for i in range(rows)
        for j in range(cols)
    ]
    assert sorted(found) == sorted(expected)


@pytest.mark.parametrize("num_shapes", [5, 1 << 30])
def test_pairs_are_sorted_by_blocks_as_one_number_or_two(num_shapes):
    rng = np.random.default_rng(0)
    block = rng.integers(0, 40, 500)
    shape = rng.integers(0, 5, 500) * (num_shapes // 5)
    found = jax.jit(sorted_pairs, static_argnums=(2, 3))(
        *(np.asarray(x, np.int32) for x in (block, shape)), 40, num_shapes
    )
    expected = sorted(zip(block, shape, strict=True))
    assert sorted(zip(*map(np.asarray, found), strict=True)) == expected
    np.testing.assert_array_equal(found[0], np.sort(block))
