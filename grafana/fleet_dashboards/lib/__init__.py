"""What the dashboards are made of: panels, tables, links, palette, variables."""
