"""State to text: the table of metric families, cached samples, the exporter's own metrics."""
