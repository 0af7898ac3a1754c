"""The published studies, each in its own room; they import the packages, never the other way."""
