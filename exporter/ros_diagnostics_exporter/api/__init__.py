"""What pages and API show: rows of the fleet, of problems and of notifications as JSON."""
