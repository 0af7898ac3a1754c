"""The command line: its help keeps every word, and every command takes the common options."""

from __future__ import annotations

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from sequencing.cli import app

COMMANDS = sorted(get_command(app).commands)
#: What rich draws around the text.
FRAME = str.maketrans(dict.fromkeys("│╭╮╰╯─*", " "))


@pytest.mark.parametrize("name", COMMANDS)
def test_help_shows_every_option_with_its_unit(name: str) -> None:
    result = CliRunner().invoke(app, [name, "--help"], env={"COLUMNS": "250"})
    assert result.exit_code == 0
    text = " ".join(result.output.translate(FRAME).split())
    for parameter in get_command(app).commands[name].params:
        if parameter.param_type_name == "option":
            assert f"--{parameter.name.replace('_', '-')}" in text
        assert " ".join(parameter.help.split()) in text


def test_some_help_texts_have_units() -> None:
    helps = [p.help for c in get_command(app).commands.values() for p in c.params]
    assert sum("[" in text for text in helps) >= 6


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_takes_seed_out_and_json(name: str) -> None:
    names = {parameter.name for parameter in get_command(app).commands[name].params}
    assert {"seed", "out", "json"} <= names
    assert "console" not in names
