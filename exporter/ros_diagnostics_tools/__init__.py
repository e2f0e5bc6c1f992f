"""The programs that people run; they reach the exporter by HTTP, or use its pure packages."""
