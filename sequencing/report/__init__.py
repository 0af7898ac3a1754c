"""Tables, pictures and scenes of a finished run."""
