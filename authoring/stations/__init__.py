"""The generator of the embedded stations and cells."""
