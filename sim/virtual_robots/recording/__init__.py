"""Recordings of diagnostics: rosbag2 and JSON."""
