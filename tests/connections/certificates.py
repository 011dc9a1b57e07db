"""Certificates for a broker and for OPC UA applications of the tests."""

from datetime import UTC, datetime, timedelta
from ipaddress import ip_address

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec, rsa
from cryptography.x509.oid import NameOID


def write_certificates(folder):
    """Write ca.pem, and server.pem with server.key for 127.0.0.1."""
    authority, server = (
        ec.generate_private_key(ec.SECP256R1()),
        ec.generate_private_key(ec.SECP256R1()),
    )
    root = _certificate("test authority", authority, "test authority", authority, is_ca=True)
    own = _certificate("127.0.0.1", server, "test authority", authority, is_ca=False)
    pem = serialization.Encoding.PEM
    (folder / "ca.pem").write_bytes(root.public_bytes(pem))
    (folder / "server.pem").write_bytes(own.public_bytes(pem))
    key = server.private_bytes(pem, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    (folder / "server.key").write_bytes(key)


def _certificate(name, key, issuer, issuer_key, *, is_ca):
    now = datetime.now(UTC)
    made = (
        x509.CertificateBuilder()
        .subject_name(x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)]))
        .issuer_name(x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, issuer)]))
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - timedelta(days=1))
        .not_valid_after(now + timedelta(days=1))
        .add_extension(x509.BasicConstraints(ca=is_ca, path_length=None), critical=True)
    )
    if not is_ca:
        address = x509.IPAddress(ip_address("127.0.0.1"))
        made = made.add_extension(x509.SubjectAlternativeName([address]), critical=False)
    return made.sign(issuer_key, hashes.SHA256())


def write_application(folder, name, uri, *, days=(-1, 1), bits=2048):
    """Write NAME.der and NAME.pem of an OPC UA application, valid between days from now."""
    key = rsa.generate_private_key(public_exponent=65537, key_size=bits)
    now = datetime.now(UTC)
    names = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    made = (
        x509.CertificateBuilder()
        .subject_name(names)
        .issuer_name(names)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now + timedelta(days=days[0]))
        .not_valid_after(now + timedelta(days=days[1]))
    )
    if uri is not None:
        alternatives = [x509.UniformResourceIdentifier(uri)]
        made = made.add_extension(x509.SubjectAlternativeName(alternatives), critical=False)
    certificate = made.sign(key, hashes.SHA256())
    encoding, form = serialization.Encoding, serialization.PrivateFormat.PKCS8
    (folder / f"{name}.der").write_bytes(certificate.public_bytes(encoding.DER))
    (folder / f"{name}.pem").write_bytes(
        key.private_bytes(encoding.PEM, form, serialization.NoEncryption())
    )
