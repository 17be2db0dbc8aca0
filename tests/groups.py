"""Marks of tests: what one process runs together, and what is left to options.

Tests that share compiled fits go one after the other. Two processes at a time would
both trace and compile the same fit; the second to begin would find nothing in the
cache.
"""

import pytest

SMALL_IMAGES = pytest.mark.xdist_group("fits of small images")
OF_POINTS = pytest.mark.xdist_group("fits of points")
LARGE_IMAGES = pytest.mark.xdist_group("fits of large images")
DATASETS = pytest.mark.xdist_group("datasets")

FULL = pytest.mark.full
"""Only run with --full, which CI gives: long, beside shorter ones of the same part."""

RELEASE = pytest.mark.release
"""Only run with --release: what CI has no time for."""
