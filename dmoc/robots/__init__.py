"""Robots of the package: data folders, and the generator that writes their URDFs."""
