"""ROS messages to model types: decoding, the aggregator's tree, numbers with units."""
