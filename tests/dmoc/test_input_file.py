"""Numbers in YAML: one reading in every version of the language, or a fault."""

import pytest

from dmoc.errors import InputError
from dmoc.input_file import read_yaml


@pytest.mark.parametrize(
    "text",
    ["010", "-010", "08", "0x1F", "0b11", "0o17", "1:30", "1:30.5", "1_3", "1_000.5", "1.0_1"]
    + ["1_0e2", "190:20:30", "!!int 010", "!!float 1:30", '!!int "1_3"'],
)
def test_a_number_that_versions_of_yaml_read_differently_is_refused(tmp_path, text):
    path = tmp_path / "x.yaml"
    path.write_text(f"a: 1\nb: [2, {text}]\n")
    with pytest.raises(InputError) as caught:
        read_yaml(path)
    (fault,) = caught.value.faults
    assert (fault.code, fault.line) == ("yaml-number", 2)
    assert fault.value.startswith("b[1]: ")


@pytest.mark.parametrize(
    ("text", "value"),
    [("10", 10), ("-3", -3), ("0", 0), ("1e-6", 1e-6), ("+1.5E3", 1500.0), (".5", 0.5)]
    + [("1.", 1.0), ("'010'", "010"), ('"1_3"', "1_3"), ("on", "on"), ("No", "No")]
    + [("true", True), ("FALSE", False), ("~", None), ("1.2.3", "1.2.3"), ("2020-01-02",) * 2]
    + [("a_1", "a_1"), ("y", "y"), (".inf", float("inf")), ("1-3", "1-3")],
)
def test_plain_values(tmp_path, text, value):
    path = tmp_path / "x.yaml"
    path.write_text(f"a: {text}\n")
    read = read_yaml(path).data["a"]
    assert read == value
    assert type(read) is type(value)
