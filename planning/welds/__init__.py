"""How a stud can be welded: admissible poses, or the reasons why there are none."""
