import os
import ssl

import pytest
import trustme

from ros_diagnostics_exporter.web.webconfig import LiveWebConfig, WebConfigError
from support.web_server import ask, connect, reloaded, renew, wait_until


@pytest.fixture
def web_config(tmp_path, ca):
    """Writes a web config with TLS and a server certificate for 127.0.0.1 beside it."""

    def write(*more: str):
        renew(ca, tmp_path)
        ca.cert_pem.write_to_path(tmp_path / "ca.crt")
        path = tmp_path / "web.yml"
        lines = ["cert_file: server.crt", "key_file: server.key", *more]
        path.write_text("tls_server_config:\n" + "".join(f"  {line}\n" for line in lines))
        return path

    return write


CLIENTS = ("client_auth_type: RequireAndVerifyClientCert", "client_ca_file: ca.crt")


def client(ca, certificate=None) -> ssl.SSLContext:
    context = ssl.create_default_context()
    ca.configure_trust(context)
    if certificate is not None:
        certificate.configure_cert(context)
    return context


def serial(server, context) -> str:
    with context.wrap_socket(connect(server), server_hostname="127.0.0.1") as sock:
        return sock.getpeercert()["serialNumber"]


def rejected(server, context) -> bool:
    """Whether the server ends the connection; with TLS 1.3 the client notices when it reads."""
    try:
        ask(server, "/metrics", tls=context)
    except (ssl.SSLError, ConnectionError):
        return True
    return False


def test_metrics_are_served_over_tls_and_plain_http_is_not(serve, web_config, ca):
    server = serve(web_config=web_config())
    assert ask(server, "/metrics", tls=client(ca)).body == b"text\n"
    plain = connect(server)
    plain.sendall(b"GET /metrics HTTP/1.1\r\nHost: x\r\n\r\n")
    assert not plain.recv(1000).startswith(b"HTTP/")
    plain.close()


def test_the_minimum_version_is_enforced(serve, web_config, ca):
    server = serve(web_config=web_config("min_version: TLS13"))
    old = client(ca)
    old.maximum_version = ssl.TLSVersion.TLSv1_2
    assert rejected(server, old)
    assert not rejected(server, client(ca))


def test_only_clients_with_a_certificate_of_the_ca_are_accepted(serve, web_config, ca):
    server = serve(web_config=web_config(*CLIENTS))
    assert rejected(server, client(ca))
    assert rejected(server, client(ca, trustme.CA().issue_cert("stranger")))
    assert not rejected(server, client(ca, ca.issue_cert("prometheus.example")))


@pytest.mark.usefixtures("seldom")
def test_a_renewed_certificate_is_used_for_the_next_client(serve, web_config, ca, caplog):
    path = web_config()
    server = serve(web_config=path)
    before = serial(server, client(ca))
    assert serial(server, client(ca)) == before
    renew(ca, path.parent)
    assert serial(reloaded(server), client(ca)) != before

    after = serial(server, client(ca))
    (path.parent / "server.key").write_text("half a key")
    assert serial(reloaded(server), client(ca)) == after
    assert caplog.text.count("server.key") == 1


def test_a_web_config_whose_files_hang_stops_nothing(serve, web_config, ca):
    path = web_config()
    server = serve(web_config=path)
    before = serial(server, client(ca))
    certificate = path.parent / "server.crt"
    whole = certificate.read_bytes()
    certificate.unlink()
    os.mkfifo(certificate)  # whoever opens it waits until somebody writes to it
    wait_until(lambda: server.loop.hangs(0.1))

    assert serial(server, client(ca)) == before
    assert ask(server, "/metrics", tls=client(ca)).status == 200
    certificate.write_bytes(whole)
    wait_until(lambda: not server.loop.hangs(0.1))


@pytest.mark.usefixtures("seldom")
def test_tls_cannot_be_switched_off_while_running(serve, web_config, ca, caplog):
    path = web_config()
    server = serve(web_config=path)
    path.write_text("")
    assert ask(reloaded(server), "/metrics", tls=client(ca)).status == 200
    assert "tls_server_config cannot be removed" in caplog.text


@pytest.mark.usefixtures("seldom")
def test_tls_cannot_be_switched_on_while_running(serve, web_config, caplog):
    path = web_config()
    whole = path.read_text()
    path.write_text("")
    server = serve(web_config=path)
    path.write_text(whole)
    assert ask(reloaded(server), "/metrics").status == 200
    assert "TLS cannot be switched on while the exporter runs" in caplog.text


def test_the_server_chooses_the_cipher_suite_unless_the_client_shall(web_config):
    for line, chooses in (((), True), (("prefer_server_cipher_suites: false",), False)):
        context = LiveWebConfig(web_config(*line)).context.current
        assert bool(context.options & ssl.OP_CIPHER_SERVER_PREFERENCE) is chooses


@pytest.mark.usefixtures("seldom")
def test_an_incomplete_file_does_not_weaken_authentication(serve, web_config, ca, caplog):
    path = web_config(*CLIENTS, "client_allowed_sans: [prometheus.example]")
    whole = path.read_text().splitlines(keepends=True)
    server = serve(web_config=path)
    for lines in range(len(whole)):
        path.write_text("".join(whole[:lines]))
        assert rejected(reloaded(server), client(ca))
        assert rejected(server, client(ca, ca.issue_cert("grafana.example")))
        assert not rejected(server, client(ca, ca.issue_cert("prometheus.example")))
    assert "client_allowed_sans cannot be removed" in caplog.text


@pytest.mark.parametrize("missing", ["server.crt", "server.key", "ca.crt"])
def test_a_missing_file_is_named_at_the_start(web_config, missing):
    path = web_config(*CLIENTS)
    (path.parent / missing).unlink()
    with pytest.raises(WebConfigError, match=missing):
        LiveWebConfig(path)


def test_an_encrypted_key_is_rejected_without_a_prompt(web_config, ca):
    from cryptography.hazmat.primitives import serialization as s

    path = web_config()
    key = s.load_pem_private_key((path.parent / "server.key").read_bytes(), None)
    secret = s.BestAvailableEncryption(b"passphrase")
    pem = key.private_bytes(s.Encoding.PEM, s.PrivateFormat.PKCS8, secret)
    (path.parent / "server.key").write_bytes(pem)
    with pytest.raises(WebConfigError, match="the key is encrypted"):
        LiveWebConfig(path)


def test_the_configured_cipher_suite_is_used(serve, web_config, ca):
    server = serve(
        web_config=web_config(
            "max_version: TLS12", "cipher_suites: [TLS_ECDHE_ECDSA_WITH_AES_256_GCM_SHA384]"
        )
    )
    with client(ca).wrap_socket(connect(server), server_hostname="127.0.0.1") as sock:
        assert sock.cipher()[:2] == ("ECDHE-ECDSA-AES256-GCM-SHA384", "TLSv1.2")
