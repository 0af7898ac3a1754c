"""Scripts that write the embedded robots and stations; not part of the wheel."""
