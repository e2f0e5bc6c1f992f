"""A site whose files were edited upgrades as docs/deployment.md says, and keeps its edits."""

import shutil
from pathlib import Path

import pytest

from support.newcomer import blocks, newcomer
from testbed.configuration import CHECKOUT

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

RULES = CHECKOUT / "prometheus" / "rules"
TEMPLATES = CHECKOUT / "alertmanager" / "templates"
SITE_RULES = "groups: [{name: site, rules: [{record: site_robots, expr: vector(1)}]}]\n"
OLD = "# of an earlier version\n"


def install_edited(etc: Path) -> None:
    """Files of an earlier version, and two that the site has edited."""
    for source, at in ((RULES, "prometheus/rules"), (TEMPLATES, "alertmanager/templates")):
        shutil.rmtree(etc / at, ignore_errors=True)
        (etc / at).mkdir(parents=True)
        for shipped in source.iterdir():
            (etc / at / shipped.name).write_text(OLD)
    for name in ("prometheus", "alertmanager"):
        shutil.copy(CHECKOUT / name / f"{name}.yml", etc / name)
    shutil.copytree(CHECKOUT / "prometheus/targets", etc / "prometheus/targets", dirs_exist_ok=True)
    (etc / "prometheus/rules/site.yml").write_text(SITE_RULES)
    site = (TEMPLATES / "site.tmpl").read_text() + "{{/* our own */}}\n"
    (etc / "alertmanager/templates/site.tmpl").write_text(site)


def test_an_upgrade_replaces_what_is_shipped_and_keeps_what_a_site_edits(tmp_path: Path):
    with newcomer(tmp_path) as person:
        etc = person.folder / "etc"
        install_edited(etc)
        (commands,) = blocks("docs/deployment.md", "## Upgrade")
        pip, *copies = commands.splitlines()
        assert "pip install --upgrade" in pip  # the tests' own environment has the new version
        person.does("mkdir -p /etc/systemd/system\n" + "\n".join(copies))

        folders = {"prometheus/rules": RULES, "alertmanager/templates": TEMPLATES}
        found = {each: each.read_text() for at in folders for each in (etc / at).iterdir()}
        edited = {each.name for each, text in found.items() if "site" in each.name and text != OLD}
        assert edited == {"site.yml", "site.tmpl"}
        assert [each.name for each, text in found.items() if text == OLD] == []
        for at, source in folders.items():
            shipped = {each.name: each.read_text() for each in source.iterdir()}
            anew = {each.name: found[each] for each in (etc / at).iterdir()}
            assert anew == {**shipped, **{name: anew[name] for name in edited & anew.keys()}}
        assert "site_robots" in found[etc / "prometheus/rules/site.yml"]
        assert "our own" in found[etc / "alertmanager/templates/site.tmpl"]
        person.does("promtool check config /etc/prometheus/prometheus.yml")
        person.does("amtool check-config /etc/alertmanager/alertmanager.yml")
