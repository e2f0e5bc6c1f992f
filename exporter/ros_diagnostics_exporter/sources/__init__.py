"""Where arrays of statuses come from. Only ``dds`` and ``dds_watch`` import rclpy."""
