"""What outlives the process: SQLite, written in small transactions by one loop."""
