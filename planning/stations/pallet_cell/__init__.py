"""The pallet cell: `cell.yaml`, joint waypoints of three robots, and the script that wrote them."""
