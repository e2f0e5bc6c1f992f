"""Nagios object files -> fleet.yml, Alertmanager routes, and a report of what has no equivalent.

`files` reads them, `inheritance` fills in templates, `site` looks objects up, `ledger` keeps what
became of each directive. `robots`, `hours`, `routes` and `inhibition` translate, `advice` says what
to do where nothing can be translated, and `convert` puts them together.
"""
