"""`./run demo`: a fault on virtual robots, from the ROS message to the email, on one machine."""
