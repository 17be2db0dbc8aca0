"""Datasets that several tests read."""

import pytest

from tests.data_synth.small import small_dataset


@pytest.fixture(scope="session")
def bop(tmp_path_factory):
    """A small dataset in folders, with normals."""
    folder = tmp_path_factory.mktemp("bop") / "dataset"
    small_dataset(folder, normals=True)
    return folder


@pytest.fixture(scope="session")
def archives(tmp_path_factory):
    """The same dataset in archives."""
    folder = tmp_path_factory.mktemp("archives") / "dataset"
    small_dataset(folder, layout="webdataset", normals=True)
    return folder
