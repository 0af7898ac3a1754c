"""Which pairs of path positions collide: maps, swept solids, and their verification."""
