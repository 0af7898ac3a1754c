"""The station file: schema, parts, studs, SRDF, and the `Station` that they build."""
