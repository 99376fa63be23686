"""docs/cli.md and the command line say the same."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import typer.main

from inhalemon.cli import app
from inhalemon.cli.failures import EXIT_CODES

TEXT = (Path(__file__).parents[1] / "docs" / "cli.md").read_text(encoding="utf-8")
SECTIONS = {
    match[1]: match[2]
    for match in re.finditer(r"^## `inhalemon (\w+)`\n(.*?)(?=^## |\Z)", TEXT, re.MULTILINE | re.DOTALL)
}
COMMANDS = typer.main.get_command(app).commands


def test_every_verb_is_documented_and_no_other():
    assert set(SECTIONS) == set(COMMANDS)


@pytest.mark.parametrize("verb", sorted(COMMANDS))
def test_every_option_is_documented_and_no_other(verb):
    real = {name for parameter in COMMANDS[verb].params for name in parameter.opts if name.startswith("--")} - {
        "--help"
    }
    documented = set(re.findall(r"`(--[a-z-]+)`", SECTIONS[verb]))
    assert documented == real


def test_every_exit_code_is_documented():
    documented = {int(code) for code in re.findall(r"^\| (\d+) \|", TEXT, re.MULTILINE)}
    assert {code for _, code in EXIT_CODES} < documented
    assert documented == {0, 1, 2, 3, 4, 130}
