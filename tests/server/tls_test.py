#!/usr/bin/env python3
"""TLS as others speak it: what versions, ciphers and certificates orbituned takes, over gRPC's port and HTTP's.

  tls_test.py ORBITUNED ORBITUNE

Certificates are made by the openssl command. Everything stays on loopback.
"""
import atexit
import http.client
import os
import shutil
import signal
import socket
import ssl
import subprocess
import sys
import tempfile
import time

ORBITUNED, ORBITUNE = sys.argv[1:3]
PATIENCE_S = 60


def openssl(*arguments, **kwargs):
    subprocess.run(["openssl", *arguments], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, **kwargs)


class Certificates:
    """An authority, and certificates of it, in a directory."""

    def __init__(self, directory, name):
        self.directory, self.name = directory, name
        self.ca = self.file(name, "crt")
        openssl("req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", "30",
                "-subj", f"/CN={name}", "-keyout", self.file(name, "key"), "-out", self.ca)

    def file(self, name, suffix):
        return os.path.join(self.directory, f"{name}.{suffix}")

    def issue(self, name, days="30"):
        """days: negative for one that has expired."""
        key, request, certificate = (self.file(name, suffix) for suffix in ("key", "csr", "crt"))
        extensions = self.file(name, "ext")
        with open(extensions, "w") as text:
            text.write("subjectAltName=DNS:localhost,IP:127.0.0.1\n")
        openssl("req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-subj", f"/CN={name}",
                "-keyout", key, "-out", request)
        openssl("x509", "-req", "-in", request, "-CA", self.ca, "-CAkey", self.file(self.name, "key"),
                "-CAcreateserial", "-days", days, "-extfile", extensions, "-out", certificate)
        return certificate, key


class Server:
    def __init__(self, directory, *arguments):
        self.output = open(os.path.join(directory, "server.out"), "w+")
        environment = {k: v for k, v in os.environ.items() if not k.startswith("ORBITUNE_")}
        self.process = subprocess.Popen(
            [ORBITUNED, "--data-dir", os.path.join(directory, "data"), "--listen", "127.0.0.1:0", "--http",
             "127.0.0.1:0", *arguments], stdout=self.output, stderr=self.output, env=environment)
        atexit.register(self.process.kill)  # however the test ends
        until(lambda: "access" in self.text() or self.process.poll() is not None)
        assert self.process.poll() is None, self.text()
        lines = dict(line.split(" ", 1) for line in self.text().splitlines() if " " in line)
        self.ports = {"grpc": int(lines["grpc"].rsplit(":", 1)[1]), "http": int(lines["http"].rsplit(":", 1)[1])}

    def text(self):
        with open(self.output.name) as text:
            return text.read()

    def stop(self):
        self.process.send_signal(signal.SIGTERM)
        assert self.process.wait(PATIENCE_S) == 0, self.text()


def until(condition):
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, "it did not come to be"
        time.sleep(0.02)


def context(ca, certificate=None, versions=(ssl.TLSVersion.TLSv1_2, ssl.TLSVersion.TLSv1_3), ciphers=None):
    made = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    made.load_verify_locations(ca)
    made.minimum_version, made.maximum_version = versions
    made.set_alpn_protocols(["h2", "http/1.1"])
    if ciphers:
        made.set_ciphers(ciphers)
    if certificate:
        made.load_cert_chain(*certificate)
    return made


def handshake(port, made):
    """The connection's version, cipher, protocol and the server's certificate; None where it is refused. With TLS 1.3 a
    client's certificate is judged only after the client's side is done: so something is read, too."""
    try:
        with socket.create_connection(("127.0.0.1", port), PATIENCE_S) as plain:
            with made.wrap_socket(plain, server_hostname="localhost") as secure:
                if secure.selected_alpn_protocol() == "http/1.1":
                    secure.sendall(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n")
                else:
                    secure.sendall(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes(3) + b"\x04" + bytes(5))
                if not secure.recv(1):
                    return None
                return (secure.version(), secure.cipher()[0], secure.selected_alpn_protocol(),
                        secure.getpeercert(binary_form=True))
    except (ssl.SSLError, ConnectionError):
        return None


def s_client(port, *arguments):
    """Whether openssl's own client, which also speaks what Python's does not, gets through."""
    done = subprocess.run(["openssl", "s_client", "-connect", f"127.0.0.1:{port}", *arguments], input=b"",
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=PATIENCE_S)
    return b"Cipher is (NONE)" not in done.stdout and b"Cipher is " in done.stdout


def check_versions_and_ciphers(server, ca):
    for name, port in server.ports.items():
        for version in (ssl.TLSVersion.TLSv1_2, ssl.TLSVersion.TLSv1_3):
            shaken = handshake(port, context(ca, versions=(version, version)))
            assert shaken, (name, version)
            assert "GCM" in shaken[1] or "CHACHA20" in shaken[1], (name, shaken[1])
            assert shaken[2] == {"grpc": "h2", "http": "http/1.1"}[name], (name, shaken[2])
        assert s_client(port, "-tls1_2", "-alpn", "h2,http/1.1"), name
        for old in ("-tls1", "-tls1_1"):
            assert not s_client(port, old, "-cipher", "ALL:@SECLEVEL=0", "-alpn", "h2,http/1.1"), (name, old)
        # No forward secrecy; CBC; none at all; no authentication; broken ones.
        for weak in ("kRSA", "ECDHE-ECDSA-AES128-SHA", "ECDHE-ECDSA-AES256-SHA384", "eNULL", "aNULL", "3DES", "DHE",
                     "CAMELLIA", "ARIA"):
            assert not s_client(port, "-tls1_2", "-cipher", f"{weak}:@SECLEVEL=0", "-alpn", "h2,http/1.1"), (name, weak)
        # In the clear there is nothing.
        with socket.create_connection(("127.0.0.1", port), PATIENCE_S) as plain:
            plain.sendall(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n")
            try:
                assert b"200" not in plain.recv(4096), name
            except ConnectionError:
                pass


def check_reload(server, directory, authority, served):
    """Certificates are replaced while a connection is open, which goes on; then by rubbish, and nothing changes."""
    def shown(port):
        shaken = handshake(port, context(authority.ca))
        return shaken and shaken[3]

    before = {port: shown(port) for port in server.ports.values()}
    kept = http.client.HTTPSConnection("localhost", server.ports["http"], timeout=PATIENCE_S,
                                       context=context(authority.ca))
    kept.request("GET", "/healthz")
    assert kept.getresponse().read() == b"ok\n"
    for old, new in zip(served, authority.issue("second")):
        shutil.copy(new, old + ".new")
        os.replace(old + ".new", old)
    for port, certificate in before.items():
        until(lambda: shown(port) not in (None, certificate))
    kept.request("GET", "/healthz")
    assert kept.getresponse().read() == b"ok\n"
    kept.close()
    after = {port: shown(port) for port in server.ports.values()}
    with open(served[0] + ".new", "w") as rubbish:
        rubbish.write("no certificate\n")
    os.replace(served[0] + ".new", served[0])
    until(lambda: shown(server.ports["http"]) and "stay as they were" in server.text())
    assert {port: shown(port) for port in server.ports.values()} == after


def check_clients(directory, authority, stranger, served):
    server = Server(directory, "--tls-cert", served[0], "--tls-key", served[1], "--tls-client-ca", authority.ca)
    good = authority.issue("client")
    for name, port in server.ports.items():
        assert handshake(port, context(authority.ca, good)), name
        assert not handshake(port, context(authority.ca)), f"{name}: without a certificate"
        assert not handshake(port, context(authority.ca, stranger.issue("thief"))), f"{name}: another authority's"
        assert not handshake(port, context(authority.ca, authority.issue("old", "-1"))), f"{name}: an expired one"
    check_cli(server, authority, good)
    server.stop()


def orbitune(*arguments, **environment):
    own = {k: v for k, v in os.environ.items() if not k.startswith("ORBITUNE_")}
    return subprocess.run([ORBITUNE, *arguments], env=own | environment, stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, text=True, timeout=PATIENCE_S)


def check_cli(server, authority, certificate):
    address = f"https://localhost:{server.ports['grpc']}"
    own = ["--tls-cert", certificate[0], "--tls-key", certificate[1]]
    done = orbitune("--server", address, "--tls-ca", authority.ca, *own, "whoami")
    assert done.returncode == 0 and "local, admin" in done.stdout, done.stderr
    assert orbitune("--server", address, "--tls-ca", authority.ca, "--timeout", "5", "whoami").returncode == 4


def check_cookie(server, directory, ca):
    """Under TLS the session's cookie is for TLS alone."""
    token = subprocess.run([ORBITUNED, "token", "create", "--name", "ana", "--role", "viewer", "--data-dir",
                            os.path.join(directory, "data")], check=True, capture_output=True, text=True).stdout.strip()
    headers = {}

    def logged_in():
        connection = http.client.HTTPSConnection("localhost", server.ports["http"], timeout=PATIENCE_S,
                                                 context=context(ca))
        connection.request("POST", "/v1/session", f'{{"token": "{token}"}}', {"Content-Type": "application/json"})
        answer = connection.getresponse()
        headers.update(answer.getheaders())
        return answer.status == 200 and "Set-Cookie" in headers

    until(logged_in)
    cookie = headers["Set-Cookie"]
    assert cookie.startswith("__Host-orbitune_session=") and "; Secure" in cookie and "; HttpOnly" in cookie, cookie
    address = f"https://localhost:{server.ports['grpc']}"
    done = orbitune("--server", address, "--tls-ca", ca, "whoami", ORBITUNE_TOKEN=token)
    assert done.stdout == "ana, viewer\n", done.stderr
    assert token not in server.text()


def check_refusal(server, ca):
    """Who sends a body before reading that it is refused can read it still."""
    with socket.create_connection(("localhost", server.ports["http"]), timeout=PATIENCE_S) as plain:
        with context(ca).wrap_socket(plain, server_hostname="localhost") as secure:
            secure.sendall(b"POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
                           b"Content-Length: 4194304\r\n\r\n")
            for _ in range(64):
                secure.sendall(bytes(65536))
            assert secure.recv(12) == b"HTTP/1.1 401"


def check_faults(directory, authority, served):
    """Files that cannot be used are refused at the start, by option and name."""
    other_key = authority.issue("other")[1]
    expired = authority.issue("expired", "-1")
    for certificate, key, option in ((served[0], other_key, "--tls-key"), ("/no/such", served[1], "--tls-cert"),
                                     (*expired, "--tls-cert"), (served[1], served[1], "--tls-cert")):
        done = subprocess.run([ORBITUNED, "--data-dir", os.path.join(directory, "data"), "--listen", "127.0.0.1:0",
                               "--http", "off", "--tls-cert", certificate, "--tls-key", key], capture_output=True,
                              text=True, timeout=PATIENCE_S)
        assert done.returncode == 1 and option in done.stderr, done.stderr


def main():
    with tempfile.TemporaryDirectory() as directory:
        authority, stranger = Certificates(directory, "authority"), Certificates(directory, "stranger")
        served = authority.issue("server")
        check_faults(directory, authority, served)
        check_clients(directory, authority, stranger, served)
        server = Server(directory, "--tls-cert", served[0], "--tls-key", served[1])
        check_versions_and_ciphers(server, authority.ca)
        check_reload(server, directory, authority, served)
        check_cookie(server, directory, authority.ca)
        check_refusal(server, authority.ca)
        server.stop()


if __name__ == "__main__":
    main()
