"""What `help` shows of each public function."""

import importlib.metadata
import inspect
import re

import impostor_jax as ij

PUBLIC = {name: getattr(ij, name) for name in ij.__all__}


def test_no_option_hides_in_a_dictionary():
    hidden = [
        f"{name}(**{parameter.name})"
        for name, one in PUBLIC.items()
        if callable(one)
        for parameter in inspect.signature(one).parameters.values()
        if parameter.kind is inspect.Parameter.VAR_KEYWORD
    ]
    assert not hidden


def test_each_argument_of_a_function_has_an_entry_in_its_docstring():
    for name, function in PUBLIC.items():
        if inspect.isfunction(function):
            text = inspect.getdoc(function).partition("\nArgs:\n")[2]
            arguments = re.split(r"\n\n\w+:\n", text)[0]
            entries = re.findall(r"^    \*?(\w+): ", arguments, re.MULTILINE)
            assert [*inspect.signature(function).parameters] == entries, name


def test_the_version_is_that_of_what_is_installed():
    assert ij.__version__ == importlib.metadata.version("impostor-jax")
