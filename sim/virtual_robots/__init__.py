"""Virtual robots: fleets of simulated robots that publish real ROS 2 diagnostics."""
