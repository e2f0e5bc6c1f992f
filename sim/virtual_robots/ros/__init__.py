"""The fleet on real ROS topics."""
