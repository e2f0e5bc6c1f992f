"""The messages around the begin of each fault, as files that ROS' tools open and replay."""
