"""A cell of several robots on one DC link: cell.yaml, its trajectories and loads."""
