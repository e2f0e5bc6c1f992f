"""The Grafana dashboards as code: built here, committed as JSON, never edited by hand."""
