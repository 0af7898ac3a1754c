"""From a station to a cycle: the lazy search for order and poses, baseline, polish, placement."""
