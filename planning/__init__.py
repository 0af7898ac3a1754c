"""One path in one station: geometry, kinematics, collision, planning, certificates."""
