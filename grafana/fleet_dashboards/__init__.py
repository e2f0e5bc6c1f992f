"""The Grafana dashboards as code; the JSON files are built from here and never edited by hand."""
