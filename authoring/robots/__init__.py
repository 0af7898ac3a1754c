"""The generator of the embedded robots' URDFs and robot.yaml."""
