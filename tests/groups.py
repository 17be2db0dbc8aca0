"""Tests that share compiled fits, so that one process runs them one after the other.

Two processes at a time would both trace and compile the same fit; the second to begin
would find nothing in the cache.
"""

import pytest

SMALL_IMAGES = pytest.mark.xdist_group("fits of small images")
LARGE_IMAGES = pytest.mark.xdist_group("fits of large images")
DATASETS = pytest.mark.xdist_group("datasets")
