"""What the dashboards share: panels, tables, variables, annotations, links, palette, PromQL."""
