"""JSON Schemas that the package ships, for tests of what it writes."""

import json
from pathlib import Path

import pytest

import impostor_jax as ij


def validator(name):
    """Of the records of a `fit`, or of what was `found`."""
    kind = pytest.importorskip("jsonschema").Draft202012Validator
    path = Path(ij.io.__file__).parent / "schemas" / f"{name}.schema.json"
    schema = json.loads(path.read_text())
    kind.check_schema(schema)
    return kind(schema)
