"""HTTP: /metrics, the landing page, the JSON API, service discovery and the lifecycle endpoints.

Everything served comes from a Backend; this package knows neither ROS nor the state. It also owns
what protects the exporter from its clients: TLS, logins, time-outs and limits.
"""
