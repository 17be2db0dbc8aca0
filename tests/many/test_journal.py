"""A journal of a run, whole or cut short."""

import contextlib

from impostor_jax.many.journal import Entry, Journal

ONE, TWO = Entry("one", "a", [{"x": 1}]), Entry("two", None, [{"reason": "broken"}])


def entries(path, names):
    with contextlib.closing(Journal(path, True)) as journal:
        return list(journal.entries(names))


def written(path, *entries):
    with contextlib.closing(Journal(path, True)) as journal:
        journal.add(entries)


def test_what_is_added_is_read_in_the_order_that_is_asked(tmp_path):
    path = tmp_path / "deep" / "run.jsonl"
    written(path, ONE, TWO)
    assert entries(path, ["two", "none", "one"]) == [TWO, ONE]
    assert (ONE.failed, TWO.failed) == (None, "broken")


def test_a_line_that_was_cut_short_is_dropped(tmp_path):
    path = tmp_path / "run.jsonl"
    written(path, ONE, TWO)
    path.write_bytes(path.read_bytes()[:-5])
    assert entries(path, ["one", "two"]) == [ONE]
    written(path, TWO)
    assert entries(path, ["one", "two"]) == [ONE, TWO]


def test_the_last_of_a_name_counts(tmp_path):
    path, again = tmp_path / "run.jsonl", Entry("two", "b", [{"x": 2}])
    written(path, ONE, TWO)
    written(path, again)
    assert entries(path, ["one", "two"]) == [ONE, again]
    with contextlib.closing(Journal(path, True)) as journal:
        assert journal.has("two", "b")
        assert not journal.has("two", "a")
        assert "none" not in journal


def test_what_failed_is_not_done(tmp_path):
    path = tmp_path / "run.jsonl"
    written(path, TWO)
    with contextlib.closing(Journal(path, True)) as journal:
        assert "two" in journal
        assert not journal.has("two", "")


def test_without_resume_it_begins_anew(tmp_path):
    path = tmp_path / "run.jsonl"
    written(path, ONE)
    Journal(path, False).close()
    assert entries(path, ["one"]) == []
