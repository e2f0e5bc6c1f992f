"""The HTTP doors: handed callables, they know neither ROS nor the state behind them."""
