"""Servers of a site with jobs and routes of others, and what docs/existing-servers.md adds.

Each piece of the page goes, as text, under the key that its first line names.
"""

import re
import textwrap

import yaml

from testbed.configuration import CHECKOUT

PAGE = CHECKOUT / "docs" / "existing-servers.md"
ALERTMANAGER = """\
global:
  smtp_smarthost: {smtp}
  smtp_require_tls: false
  smtp_from: alertmanager@example.org
templates:
- own/*.tmpl
route:
  receiver: ops
  group_by: [alertname, cluster]
  group_wait: 30s
  group_interval: 5m
  repeat_interval: 12h
  routes:
  - matchers: [alertname = Watchdog]
    receiver: heartbeat
    group_wait: 0s
  - matchers: [severity = critical]
    receiver: pager
inhibit_rules:
  - source_matchers: [severity = critical]
    target_matchers: [severity =~ "warning|info"]
    equal: [cluster]
receivers:
- name: ops
  email_configs: [{{to: ops@example.org}}]
- name: pager
  email_configs: [{{to: pager@example.org}}]
- name: heartbeat
  email_configs: [{{to: heartbeat@example.org}}]
"""
# As kube-prometheus-stack has it, with its inhibitions, the last one of which has no source.
STACK = """\
global:
  smtp_smarthost: {smtp}
  smtp_require_tls: false
  smtp_from: alertmanager@example.org
inhibit_rules:
- source_matchers:
  - severity = critical
  target_matchers:
  - severity =~ warning|info
  equal: [namespace, alertname]
- source_matchers:
  - severity = warning
  target_matchers:
  - severity = info
  equal: [namespace, alertname]
- source_matchers:
  - alertname = InfoInhibitor
  target_matchers:
  - severity = info
  equal: [namespace]
- target_matchers:
  - alertname = InfoInhibitor
receivers:
- name: "null"
route:
  group_by: [namespace]
  group_interval: 5m
  group_wait: 30s
  receiver: "null"
  repeat_interval: 12h
  routes:
  - matchers: [alertname = "Watchdog"]
    receiver: "null"
templates:
- own/*.tmpl
"""
PROMETHEUS = """\
global:
  scrape_interval: {interval}
  evaluation_interval: {interval}
  external_labels: {{cluster: prod}}
alerting:
  alertmanagers:
  - static_configs: [{{targets: ["{alertmanager}"]}}]
rule_files:
- own/*.yml
scrape_configs:
- job_name: monitoring
  static_configs:
  - targets: ["{prometheus}", "{alertmanager}"]
    labels: {{fleet: servers, team: ops}}
"""
OWN_RULES = """\
groups:
- name: own
  rules:
  - record: team:up:count
    expr: count by (team) (up)
  - {alert: Watchdog, expr: vector(1), labels: {severity: none}}
  - alert: DiskFull
    expr: |2
        label_replace(vector(1), "disk", "sda", "", "")
      or
        label_replace(vector(2), "disk", "sdb", "", "")
    labels: {severity: warning}
"""


def added(config: str, file: str) -> str:
    """The configuration with the page's pieces for this file, and the change that it shows."""
    page = PAGE.read_text()
    pieces = re.findall(rf"```yaml\n# {re.escape(file)}, under (\w+):\n(.*?)```", page, re.DOTALL)
    assert pieces, f"{PAGE} has nothing for {file}"
    for key, piece in pieces:
        place = re.compile(rf"^( *){key}:\n( *)(?=- )", re.MULTILINE)
        found = place.search(config)
        assert found, f"{file} has no {key}"
        indented = textwrap.indent(piece, found[2])
        config = config[: found.end(1)] + f"{key}:\n{indented}{found[2]}" + config[found.end() :]
    if file == "alertmanager.yml":
        changes = re.findall(r"^([-+]) {2,}((?:source|target)_matchers: .*)", page, re.MULTILINE)
        removed, exempt = (
            [line for sign, line in changes if sign == wanted] for wanted in ("-", "+")
        )
        for before, after in zip(removed, exempt, strict=True):
            config = config.replace(before, after)
    return config


def exempted(config: str) -> str:
    """Alertmanager's configuration, with the page's matcher in each inhibition, on both sides."""
    changes = re.findall(
        r"^\+ {2,}(source|target)_matchers: \[.*, (.*)\]", PAGE.read_text(), re.MULTILINE
    )
    assert [side for side, _matcher in changes] == ["source", "target"]
    content = yaml.safe_load(config)
    for rule in content["inhibit_rules"]:
        if "RosDiagnostics" not in str(rule):  # not one of the page, and not changed as it shows
            for side, matcher in changes:
                rule.setdefault(f"{side}_matchers", []).append(matcher)
    return yaml.safe_dump(content, sort_keys=False)
