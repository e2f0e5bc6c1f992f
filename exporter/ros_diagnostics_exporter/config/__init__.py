"""fleet.yml read, checked and resolved once into one frozen Fleet; knows no clock, ROS or HTTP."""
