"""Kept for importers: YAML with line numbers lives in `dmoc.yaml_file`."""

from dmoc.yaml_file import FieldPath, YamlTree, field_name, read_yaml

__all__ = ["FieldPath", "YamlTree", "field_name", "read_yaml"]
