"""A robot as its maker describes it: URDF and robot.yaml in, limits, drive and `pin.Model` out."""
