"""Every PromQL expression of the dashboards, by dashboard. Knows no panel.

They read the recorded states (prometheus/rules) where there is one: that is what makes them cheap.
`$fleet`, `$site`, `$robot_group` may be several or all, so they match as regular expressions;
`$robot` alone on its dashboard, `$component` and `$key` on theirs are one, and match exactly.
"""
