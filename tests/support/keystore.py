"""A keystore as `ros2 security create_keystore` and `create_enclave` make it; sros2 is no wheel.

One authority signs identities, governance and permissions; file names, curve and S/MIME options are
those of sros2 0.13.
"""

import datetime as dt
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import pkcs7
from cryptography.x509.oid import NameOID

DAY = dt.timedelta(days=1)
# All is encrypted, and nobody without an identity is let in: the default of sros2.
GOVERNANCE = """\
<dds><domain_access_rules><domain_rule>
  <domains><id>{domain_id}</id></domains>
  <allow_unauthenticated_participants>false</allow_unauthenticated_participants>
  <enable_join_access_control>true</enable_join_access_control>
  <discovery_protection_kind>ENCRYPT</discovery_protection_kind>
  <liveliness_protection_kind>ENCRYPT</liveliness_protection_kind>
  <rtps_protection_kind>SIGN</rtps_protection_kind>
  <topic_access_rules><topic_rule>
    <topic_expression>*</topic_expression>
    <enable_discovery_protection>true</enable_discovery_protection>
    <enable_liveliness_protection>true</enable_liveliness_protection>
    <enable_read_access_control>true</enable_read_access_control>
    <enable_write_access_control>true</enable_write_access_control>
    <metadata_protection_kind>ENCRYPT</metadata_protection_kind>
    <data_protection_kind>ENCRYPT</data_protection_kind>
  </topic_rule></topic_access_rules>
</domain_rule></domain_access_rules></dds>
"""


class Keystore:
    """An authority, and the enclaves that it has signed."""

    def __init__(self, folder: Path, domain_id: int) -> None:
        self._folder = folder
        self._key = ec.generate_private_key(ec.SECP256R1())
        self._name = _name("sros2CA")
        self._certificate = self._certify(self._name, self._key, is_authority=True)
        self._governance = GOVERNANCE.format(domain_id=domain_id)

    def add_enclave(self, path: str, permissions: str) -> Path:
        """An identity with these permissions (XML); the folder of its files."""
        folder = self._folder / "enclaves" / path.lstrip("/")
        folder.mkdir(parents=True)
        key = ec.generate_private_key(ec.SECP256R1())
        certificate = self._certify(_name(path), key, is_authority=False)
        pem = serialization.Encoding.PEM
        for name, of in (
            ("identity_ca.cert.pem", self._certificate),
            ("permissions_ca.cert.pem", self._certificate),
            ("cert.pem", certificate),
        ):
            (folder / name).write_bytes(of.public_bytes(pem))
        plain = serialization.NoEncryption()
        form = serialization.PrivateFormat.PKCS8
        (folder / "key.pem").write_bytes(key.private_bytes(pem, form, plain))
        (folder / "governance.p7s").write_bytes(self._sign(self._governance))
        (folder / "permissions.p7s").write_bytes(self._sign(permissions))
        return folder

    def _sign(self, text: str) -> bytes:
        builder = pkcs7.PKCS7SignatureBuilder().set_data(text.encode())
        options = [pkcs7.PKCS7Options.Text, pkcs7.PKCS7Options.DetachedSignature]
        signed = builder.add_signer(self._certificate, self._key, hashes.SHA256())
        return signed.sign(serialization.Encoding.SMIME, options)

    def _certify(
        self, name: x509.Name, key: ec.EllipticCurvePrivateKey, *, is_authority: bool
    ) -> x509.Certificate:
        now = dt.datetime.now(dt.timezone.utc)
        builder = x509.CertificateBuilder(self._name, name, key.public_key())
        builder = builder.serial_number(x509.random_serial_number())
        builder = builder.not_valid_before(now - DAY).not_valid_after(now + DAY)
        limits = x509.BasicConstraints(ca=is_authority, path_length=1 if is_authority else None)
        builder = builder.add_extension(limits, critical=is_authority)
        return builder.sign(self._key, hashes.SHA256())


def _name(common: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common)])
