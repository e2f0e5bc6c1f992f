"""Where arrays of statuses come from. Of its modules only ``dds*`` import rclpy."""
