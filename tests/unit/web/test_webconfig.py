import pytest

from ros_diagnostics_exporter.web.webconfig import RateLimit, WebConfig, WebConfigError, read

HASH = "$2y$10$mDwo.lAisC94iLAyP81MCesa29IzH37oigHC/42V2pdJlUprsJPze"
TLS = "tls_server_config: {cert_file: a.crt, key_file: keys/a.key"


@pytest.fixture
def web_config(tmp_path):
    def write(text: str):
        path = tmp_path / "web.yml"
        path.write_text(text)
        return path

    return write


def test_an_empty_file_sets_nothing(web_config):
    assert read(web_config("# later\n")) == WebConfig()


def test_a_file_in_the_exporter_toolkit_format(web_config, tmp_path):
    config = read(
        web_config(
            f"""
tls_server_config:
  cert_file: server.crt
  key_file: /etc/keys/server.key
  client_auth_type: RequireAndVerifyClientCert
  client_ca_file: ca.crt
  client_allowed_sans: [prometheus.example]
  min_version: TLS13
  max_version: TLS13
  cipher_suites: [TLS_ECDHE_RSA_WITH_AES_128_GCM_SHA256]
  prefer_server_cipher_suites: false
http_server_config:
  http2: false
  headers: {{Strict-Transport-Security: max-age=60, X-Frame-Options: sameorigin}}
basic_auth_users: {{alice: {HASH}}}
rate_limit: {{interval: 500ms, burst: 20}}
"""
        )
    )
    tls = config.tls_server_config
    assert tls is not None
    assert [str(path) for path in tls.files] == [
        str(tmp_path / "server.crt"),
        "/etc/keys/server.key",
        str(tmp_path / "ca.crt"),
    ]
    assert tls.cipher_suites == ("ECDHE-RSA-AES128-GCM-SHA256",)
    assert config.http_server_config.headers.x_frame_options == "sameorigin"
    assert config.basic_auth_users == {"alice": HASH}
    assert (config.rate_limit.interval, config.rate_limit.burst) == (0.5, 20)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("\nusers: {}", ":2: users: unknown key"),
        (TLS + ", ca: x}", "tls_server_config.ca: unknown key"),
        ("tls_server_config: {cert_file: a}", "tls_server_config.key_file: Field required"),
        (TLS + ", cert: PEM}", "cert: PEM text is not supported here; write cert_file"),
        (TLS + ", curve_preferences: [X25519]}", "curve_preferences is not supported"),
        (TLS + ", min_version: TLS10}", "TLS10 is not supported, RFC 8996"),
        (TLS + ", min_version: TLS13, max_version: TLS12}", "min_version is above max_version"),
        (TLS + ", client_auth_type: RequestClientCert}", "without verifying them"),
        (TLS + ", client_auth_type: RequireAndVerifyClientCert}", "give both"),
        (TLS + ", client_ca_file: ca.crt}", "give both"),
        (TLS + ", client_ca_file: ca.crt, client_ca: PEM}", "not both"),
        (TLS + ", client_allowed_sans: [a]}", "RequireAndVerifyClientCert"),
        (TLS + ", cipher_suites: [TLS_RSA_WITH_RC4_128_SHA]}", "unknown cipher suite"),
        ("basic_auth_users: {alice: hunter2}", "basic_auth_users.alice: is not a bcrypt hash"),
        ("rate_limit: {interval: soon, burst: 1}", "'soon' is not a duration"),
        ("rate_limit: {interval: 1s}", "burst must be at least 1"),
        ("rate_limit: {burst: -1}", "rate_limit.burst: Input should be greater than or equal to 0"),
        ("http_server_config: {headers: {X-Frame-Options: allow}}", "X-Frame-Options"),
        ("- a list", ":1: Input should be a valid dictionary"),
        ("a: [", "is not valid YAML"),
        ("basic_auth_users: {}\nbasic_auth_users: {}", "2: basic_auth_users: is given twice"),
    ],
)
def test_an_error_names_file_line_and_key(web_config, text, complaint):
    path = web_config(text)
    with pytest.raises(WebConfigError) as error:
        read(path)
    assert complaint in str(error.value)
    assert "hunter2" not in str(error.value)  # a password
    assert all(line.startswith(f"{path}:") for line in str(error.value).splitlines())


def test_a_rate_of_no_limit_or_of_one_request(web_config):
    for text in "interval: 0", "burst: 0", "interval: 0, burst: 0":
        assert read(web_config(f"rate_limit: {{{text}}}")).rate_limit == RateLimit()
    assert read(web_config("rate_limit: {interval: 1s, burst: 1}")).rate_limit.interval == 1.0


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(WebConfigError, match=r"web\.yml"):
        read(tmp_path / "web.yml")
