"""Where arrays of statuses come from. Only ``dds`` imports rclpy."""
