"""Stations of the package: data folders, and the generator that writes them."""
