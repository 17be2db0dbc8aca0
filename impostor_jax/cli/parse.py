"""Parsing of the command line."""

__all__ = ["parse", "parse_with"]

import ast
import contextlib
import io
import itertools
import re
import sys
from collections.abc import Sequence
from typing import Annotated, Any

import tyro

import impostor_jax
from impostor_jax.cli.calibrate_command import CalibrateCommand
from impostor_jax.cli.demo_command import DemoCommand
from impostor_jax.cli.doctor_command import DoctorCommand
from impostor_jax.cli.evaluate_command import EvaluateCommand
from impostor_jax.cli.export_command import ExportCommand
from impostor_jax.cli.find_command import FindCommand
from impostor_jax.cli.fit_command import FitCommand
from impostor_jax.cli.parity_command import ParityCommand
from impostor_jax.cli.render_command import RenderCommand
from impostor_jax.cli.track_command import TrackCommand

Command = (
    Annotated[FitCommand, tyro.conf.subcommand("fit")]
    | Annotated[FindCommand, tyro.conf.subcommand("find")]
    | Annotated[TrackCommand, tyro.conf.subcommand("track")]
    | Annotated[CalibrateCommand, tyro.conf.subcommand("calibrate")]
    | Annotated[RenderCommand, tyro.conf.subcommand("render")]
    | Annotated[ExportCommand, tyro.conf.subcommand("export")]
    | Annotated[DemoCommand, tyro.conf.subcommand("demo")]
    | Annotated[EvaluateCommand, tyro.conf.subcommand("evaluate")]
    | Annotated[ParityCommand, tyro.conf.subcommand("parity")]
    | Annotated[DoctorCommand, tyro.conf.subcommand("doctor")]
)

NOT_PARSED = (
    r"Error parsing (\S+): no type matching (?:\{None\}\|)?\{?([^{}]+)\}? could be "
    r"instantiated from (\[.*?\])\. Got errors"
)
"""Of tyro, for a flag whose value may also be left out."""


def parse(arguments: Sequence[str]) -> Command:
    """Parse the arguments; a mistake ends the program with one line and exit code 2."""
    description = "Find capped cylinders in depth images, fit and render them."
    return parse_with(Command, "impostor-jax", description, arguments)


def parse_with(
    commands: Any, program: str, description: str, arguments: Sequence[str]
) -> Any:
    """Parse the arguments of a program; a mistake ends it as `parse` says.

    `--version` alone prints the version of both programs, which are of one package.

    Args:
        commands: Union of the dataclasses of the subcommands.
        program: Name of the program.
        description: What it does.
        arguments: What was typed after its name.

    Returns:
        An instance of one of the dataclasses.
    """
    if list(arguments) == ["--version"]:
        print(f"{program} {impostor_jax.__version__}")
        raise SystemExit(0)
    if (flag := _empty(arguments)) is not None:
        # An empty path would else be the current folder.
        print(f"{program}: error: {flag} must not be empty", file=sys.stderr)
        raise SystemExit(2)
    errors = io.StringIO()
    try:
        with contextlib.redirect_stderr(errors):
            return tyro.cli(
                commands,
                prog=program,
                description=f"{description} --version prints the version.",
                args=arguments,
                config=(tyro.conf.OmitArgPrefixes,),
            )
    except SystemExit as stop:
        if stop.code in (0, None):
            raise
        message = _one_line(errors.getvalue())
        print(f"{program}: error: {message}", file=sys.stderr)
        raise SystemExit(2) from None


def _empty(arguments: Sequence[str]) -> str | None:
    """What is given an empty value; None where nothing is."""
    for before, argument in itertools.pairwise(["", *arguments]):
        if argument == "":
            return before if before.startswith("--") else "an argument"
        if argument.startswith("--") and argument.endswith("="):
            return argument[:-1]
    return None


def _one_line(box: str) -> str:
    """Message of an error box of tyro's, without its frame and its hints."""
    plain = re.sub(r"\x1b\[[0-9;]*m", "", box)
    lines = [line.strip("│ ") for line in plain.splitlines()]
    message = []
    for line in lines:
        if line.startswith(("─", "╰")):
            break
        if not line.startswith("╭"):
            message.append(line)
    words = " ".join(" ".join(message).split())
    if found := re.match(NOT_PARSED, words):
        flag, needed, given = found.groups()
        words = f"{flag} must be {needed}, got {' '.join(ast.literal_eval(given))}"
    if near := re.search(r"Perhaps you meant:\n(--[\w-]+)", "\n".join(lines)):
        words += f"; did you mean {near[1]}?"
    return words or "the arguments are not understood"
