"""The rules as objects of the Prometheus Operator: `python tools/prometheus_operator.py --help`.

Writes a PrometheusRule for each file of prometheus/rules, and with --target a ScrapeConfig for
exporters outside of the cluster, as one YAML file for `kubectl apply -f`. Needs PyYAML only.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import yaml

import mixin

CHECKOUT = Path(__file__).resolve().parents[1]
BASE = CHECKOUT / "packaging" / "kubernetes" / "rules" / "rules.yaml"
SERVERS = (
    "servers"  # the rules about Prometheus and Alertmanager, which such sites watch themselves
)
RUNBOOKS = "http://localhost:9877/runbooks"  # below site.exporter_url of the mails
# What of the metrics, how often: as the two jobs of prometheus/prometheus.yml.
SCRAPES: dict[str, tuple[str, dict[str, list[str]]]] = {
    "ros-diagnostics-faults": ("2s", {"collect[]": ["faults"]}),
    "ros-diagnostics": ("15s", {"exclude[]": ["faults"]}),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the objects to standard output; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--namespace", help="of the objects; default: that of kubectl")
    parser.add_argument(
        "--label",
        action="append",
        default=[],
        type=_pair,
        metavar="NAME=VALUE",
        help="that Prometheus' ruleSelector and scrapeConfigSelector ask for; repeatable",
    )
    parser.add_argument(
        "--target", action="append", default=[], metavar="HOST:PORT", help="exporter; repeatable"
    )
    parser.add_argument("--servers", action="store_true", help=f"with the rules of {SERVERS}.yml")
    parser.add_argument(
        "--runbooks",
        metavar="URL",
        default=RUNBOOKS,
        help="where the exporter serves the runbooks, for the runbook_url of each alert; "
        "default: %(default)s",
    )
    options = parser.parse_args(arguments)
    metadata: dict[str, Any] = {"namespace": options.namespace} if options.namespace else {}
    if options.label:
        metadata["labels"] = dict(options.label)
    made = rules(metadata, servers=options.servers, runbooks=options.runbooks)
    found = [*made, *scrapes(metadata, options.target)]
    sys.stdout.write(_yaml(found))
    return 0


def files() -> dict[Path, str]:
    """The rules of the base for Kubernetes."""
    return {BASE: _yaml(rules({}, servers=False, runbooks=RUNBOOKS))}


def _yaml(found: Iterable[dict[str, Any]]) -> str:
    return yaml.dump_all(found, Dumper=_Dumper, sort_keys=False, width=10_000)


def rules(metadata: dict[str, Any], *, servers: bool, runbooks: str) -> Iterator[dict[str, Any]]:
    """A PrometheusRule for each rule file; ``servers``: also for those about the servers."""
    for name, groups in mixin.groups():
        if name != SERVERS or servers:
            yield {
                "apiVersion": "monitoring.coreos.com/v1",
                "kind": "PrometheusRule",
                "metadata": {"name": f"ros-diagnostics-{name}", **metadata},
                "spec": {"groups": [_with_runbooks(group, runbooks) for group in groups]},
            }


def _with_runbooks(group: dict[str, Any], runbooks: str) -> dict[str, Any]:
    return {**group, "rules": [_with_runbook(rule, runbooks) for rule in group["rules"]]}


def _with_runbook(rule: dict[str, Any], runbooks: str) -> dict[str, Any]:
    """A copy: in YAML, several alerts share their annotations."""
    if "alert" not in rule:
        return rule
    url = f"{runbooks.rstrip('/')}/{rule['alert']}.html"
    return {**rule, "annotations": {**rule.get("annotations", {}), "runbook_url": url}}


def scrapes(metadata: dict[str, Any], targets: Sequence[str]) -> Iterator[dict[str, Any]]:
    """A ScrapeConfig for each job of prometheus.yml that scrapes exporters; none if no targets."""
    for name, (interval, parameters) in SCRAPES.items():
        if targets:
            yield {
                "apiVersion": "monitoring.coreos.com/v1alpha1",
                "kind": "ScrapeConfig",
                "metadata": {"name": name, **metadata},
                "spec": {
                    "staticConfigs": [{"targets": list(targets)}],
                    "honorLabels": True,
                    "scrapeInterval": interval,
                    "scrapeTimeout": interval,
                    "params": parameters,
                },
            }


def _pair(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not (name and equals):
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=VALUE")
    return name, value


class _Dumper(yaml.SafeDumper):
    """Without anchors, and expressions as blocks, so that people can read them."""

    def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002 - PyYAML's
        return True


def _text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, "|" if "\n" in text else None)


_Dumper.add_representer(str, _text)

if __name__ == "__main__":
    sys.exit(main())
