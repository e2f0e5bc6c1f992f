"""The weekly report: numbers from Prometheus' recorded series and the event log, as HTML."""
