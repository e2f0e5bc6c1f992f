import pytest

from ros_diagnostics_exporter.config.errors import WrongValueError
from ros_diagnostics_exporter.config.links import MAX_URL, filled, link


def test_a_link_has_the_robots_name_and_its_host():
    links = {"camera": "http://{address}:8080/?r={robot}", "wiki": "https://w/{robot}"}

    assert filled(links, "a/b &", "[::1]") == {
        "camera": "http://[::1]:8080/?r=a%2Fb%20%26",
        "wiki": "https://w/a%2Fb%20%26",
    }


def test_without_a_host_the_links_that_need_it_are_left_out():
    links = {"camera": "http://{address}:8080/", "wiki": "https://w/{robot}"}

    assert filled(links, "r", "") == {"wiki": "https://w/r"}


@pytest.mark.parametrize(
    "url",
    [
        *("javascript:alert(1)", "JAVASCRIPT:x", "ftp://x", "//x", "/x", "https://", "http://a b"),
        *("http://{host}/", "http://}{", "https://x\n", "https://x\u202e", "data:text/html,x"),
        "https://" + "x" * MAX_URL,
    ],
)
def test_what_is_no_address_of_the_web_is_no_link(url):
    with pytest.raises(WrongValueError, match="is not the URL of a page"):
        link(url)


@pytest.mark.parametrize("url", ["http://x", "https://x/y?z=1#a", "http://{address}:80/{robot}"])
def test_an_address_of_the_web_is_a_link(url):
    assert link(url) == url
