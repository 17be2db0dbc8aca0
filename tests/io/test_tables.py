"""Tables of what was found."""

import csv

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.io import tables
from impostor_jax.io.found_table import table_of
from impostor_jax.io.tables import write_rows
from tests.page.scenes import can_fit


def found_of(count):
    """A search of an image that found a can so many times."""
    fits = (can_fit(),) * count
    masks = np.zeros((count, 4, 5), bool)
    some, inside = np.full(count, 0.75), np.zeros(count, bool)
    planes = ij.Plane(np.zeros((0, 3)), np.zeros((0, 3)))
    return ij.Found(fits, masks, some, some, inside, planes)


def test_a_row_has_the_numbers_of_the_record():
    record = found_of(2).to_dict()["cylinders"][1]
    row = table_of(found_of(2))[1]
    assert row["label"] == 2
    assert [row[f"center_m_{k}"] for k in "xyz"] == record["center_m"]
    assert row["std_radius_m"] == record["std"]["radius_m"]
    assert not any(isinstance(value, list | dict) for value in row.values())


def test_what_is_written_is_read_again(tmp_path):
    rows = table_of(found_of(2))
    ij.write_table(found_of(2), tmp_path / "found.csv")
    with (tmp_path / "found.csv").open(newline="") as file:
        read = list(csv.DictReader(file))
    assert [float(one["radius_m"]) for one in read] == [r["radius_m"] for r in rows]
    assert list(read[0]) == list(rows[0])


def test_parquet_is_read_by_pyarrow(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    rows = table_of(found_of(2))
    ij.write_table(found_of(2), tmp_path / "found.parquet")
    assert parquet.read_table(tmp_path / "found.parquet").to_pylist() == rows


def test_of_nothing_the_table_is_empty(tmp_path):
    ij.write_table(found_of(0), tmp_path / "found.csv")
    assert (tmp_path / "found.csv").read_text() == ""


def test_another_kind_of_file_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"path must end with \.csv or \.parquet"):
        ij.write_table(found_of(1), tmp_path / "found.xlsx")


ROWS = [
    {"image": "0012", "object": 1, "status": "converged", "radius_m": 0.25,
     "seen": True, "covariance": [1.0, 0.5, None]},
    {"image": "b, c", "object": None, "status": "failed", "reason": 'no "x"\nat all'},
]  # fmt: skip


@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_rows_of_other_columns_are_read_as_one_table(ending, tmp_path):
    if ending == ".parquet":
        pytest.importorskip("pyarrow")
    path = tmp_path / f"results{ending}"
    write_rows(lambda: ROWS, path)
    read = ij.read_results(path)
    assert list(read) == [*ROWS[0], "reason"]
    assert read["image"].tolist() == ["0012", "b, c"]
    np.testing.assert_array_equal(read["object"], [1, np.nan])
    np.testing.assert_array_equal(read["radius_m"], [0.25, np.nan])
    assert read["reason"].tolist() == ["", 'no "x"\nat all']
    assert read["seen"].tolist() == [True, None]
    np.testing.assert_array_equal(read["covariance"][0], [1, 0.5, np.nan])
    assert read["covariance"][1] is None


@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_a_table_of_no_rows_is_empty(ending, tmp_path):
    if ending == ".parquet":
        pytest.importorskip("pyarrow")
    path = tmp_path / f"results{ending}"
    write_rows(list, path)
    assert ij.read_results(path) == {}


def test_parts_of_a_large_table_follow_each_other(tmp_path, monkeypatch):
    parquet = pytest.importorskip("pyarrow.parquet")
    monkeypatch.setattr(tables, "AT_ONCE", 2)
    path = tmp_path / "results.parquet"
    write_rows(lambda: ({"object": k} for k in range(5)), path)
    assert ij.read_results(path)["object"].tolist() == [*range(5)]
    assert parquet.ParquetFile(path).num_row_groups == 3


def test_what_is_no_table_is_refused(tmp_path):
    with pytest.raises(ValueError, match="does not exist"):
        ij.read_results(tmp_path / "none.csv")
    (tmp_path / "a.parquet").write_bytes(b"nothing")
    pytest.importorskip("pyarrow")
    with pytest.raises(ValueError, match="is no Parquet file"):
        ij.read_results(tmp_path / "a.parquet")
    (tmp_path / "a.txt").write_text("")
    with pytest.raises(ValueError, match=r"must be one of \.csv, \.parquet"):
        ij.read_results(tmp_path / "a.txt")
