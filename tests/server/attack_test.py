#!/usr/bin/python3
"""The attack list: what hostile clients send, over gRPC and HTTP, to a server of its own.

    attack_test.py ORBITUNED REPOSITORY [ATTACK...]

Every attack must meet a clean refusal (or harmlessly succeed): never an internal error, a crash, a stall, another's data
or another's memory. Afterwards the server is alive, what was stored before is what it was, and memory is flat. The
requests come from the proto's descriptors, so that a new RPC or field is attacked without being named here.
"""

import concurrent.futures
import gzip
import http.client
import json
import os
import pathlib
import random
import re
import signal
import socket
import sqlite3
import struct
import subprocess
import sys
import tempfile
import time
import urllib.parse
import warnings

import grpc
from google.protobuf import descriptor_pb2, descriptor_pool, json_format, message_factory
from google.protobuf.descriptor import FieldDescriptor

GOOGLEAPIS = "/usr/share/gocode/src/github.com/grpc-ecosystem/grpc-gateway/third_party/googleapis"
PATIENCE_S = 300
MIB = 1 << 20
# The server's own refusals. Not among them: INTERNAL, UNKNOWN, DATA_LOSS, UNAVAILABLE, DEADLINE_EXCEEDED.
CLEAN = {grpc.StatusCode[name] for name in (
    "OK", "INVALID_ARGUMENT", "NOT_FOUND", "ALREADY_EXISTS", "FAILED_PRECONDITION", "ABORTED", "OUT_OF_RANGE",
    "RESOURCE_EXHAUSTED", "PERMISSION_DENIED", "UNAUTHENTICATED")}
# What gRPC says of bytes that it cannot parse, and only of those.
UNREADABLE = {grpc.StatusCode.INTERNAL, grpc.StatusCode.UNIMPLEMENTED}
# Of headers beyond all bounds: refused, or the connection is closed.
ENDED = {grpc.StatusCode.RESOURCE_EXHAUSTED, grpc.StatusCode.UNAVAILABLE}
PAYLOADS = [
    "'; DROP TABLE jobs; --",
    "\" OR 1=1; DELETE FROM iterations; --",
    "x') UNION SELECT sql FROM sqlite_master--",
    "state = \"x'; DROP TABLE jobs; --\"",
    "a\r\nX-Injected: yes\r\n\r\n",
    "../../../../etc/passwd",
    "jobs/../../etc/passwd",
    "%s%n%00%2e%2e",
    "nul\0inside",
    "\u202e\ufeff\U0001f680",
    "{\"a\":[",
]


class Server:
    def __init__(self, binary, directory):
        self.output = open(f"{directory}/server.log", "w+", encoding="utf-8")
        environment = {k: v for k, v in os.environ.items() if not k.startswith("ORBITUNE_")}
        self.data = f"{directory}/data"
        self.process = subprocess.Popen(
            [binary, "--data-dir", self.data, "--listen", "127.0.0.1:0", "--http", "127.0.0.1:0"],
            stdout=self.output, stderr=self.output, env=environment)
        until(lambda: re.search(r"^threads ", self.text(), re.MULTILINE) or self.process.poll() is not None)
        assert self.process.poll() is None, self.text()
        self.grpc, self.http = (re.search(rf"^{name} (\S+)$", self.text(), re.MULTILINE)[1] for name in ("grpc", "http"))

    def text(self):
        return pathlib.Path(self.output.name).read_text(encoding="utf-8")

    def memory_mib(self, which):
        """VmRSS: now; VmHWM: the most it has ever been."""
        status = pathlib.Path(f"/proc/{self.process.pid}/status").read_text()
        return int(re.search(rf"{which}:\s*(\d+) kB", status)[1]) / 1024

    def stop(self):
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(PATIENCE_S)


def until(condition):
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.05)


class Api:
    """The services as the proto describes them."""

    def __init__(self, repository, directory, address):
        files = [str(p.relative_to(f"{repository}/proto")) for p in pathlib.Path(repository, "proto/orbitune").rglob("*.proto")]
        described = f"{directory}/descriptors"
        subprocess.run(["protoc", f"-I{repository}/proto", f"-I{GOOGLEAPIS}", "--include_imports",
                        f"--descriptor_set_out={described}", *files], check=True)
        self.pool = descriptor_pool.DescriptorPool()
        descriptors = descriptor_pb2.FileDescriptorSet.FromString(pathlib.Path(described).read_bytes())
        for file in descriptors.file:
            self.pool.Add(file)
        self.factory = message_factory.MessageFactory(self.pool)
        services = [f"{file.package}.{service.name}" for file in descriptors.file for service in file.service]
        self.methods = {method.full_name: method for service in services
                        for method in self.pool.FindServiceByName(service).methods}
        assert len(self.methods) >= 25, sorted(self.methods)
        self.streaming = {f"{file.package}.{service.name}.{method.name}" for file in descriptors.file
                          for service in file.service for method in service.method if method.server_streaming}
        self.channel = grpc.insecure_channel(address, [("grpc.max_send_message_length", -1),
                                                       ("grpc.max_receive_message_length", -1)])

    def request(self, method, fields):
        message = self.factory.GetPrototype(self.methods[method].input_type)()
        return json_format.ParseDict(fields, message)

    def send(self, method, data, **options):
        """Status code, details, and the answer (of a stream: its first message)."""
        service, name = method.rsplit(".", 1)
        make = self.channel.unary_stream if method in self.streaming else self.channel.unary_unary
        call = make(f"/{service}/{name}", lambda data: data, self.factory.GetPrototype(self.methods[method].output_type).FromString)
        try:
            answer = call(data, timeout=PATIENCE_S, wait_for_ready=True, **options)
            if method in self.streaming:
                stream, answer = answer, next(answer, None)
                stream.cancel()
            return grpc.StatusCode.OK, "", answer
        except grpc.RpcError as error:
            return error.code(), error.details(), None

    def call(self, method, fields, **options):
        return self.send(method, self.request(method, fields).SerializeToString(), **options)


def http_request(server, method, target, body=None, headers=None):
    """Code, headers, body; code 0 where the connection was closed without an answer."""
    connection = http.client.HTTPConnection(server.http, timeout=PATIENCE_S)
    try:
        connection.putrequest(method, target, skip_accept_encoding=True)
        headers = dict(headers or {})
        if body is not None:
            headers.setdefault("Content-Length", str(len(body)))
        for name, value in headers.items():
            connection.putheader(name, value)
        try:
            connection.endheaders(body)
        except (BrokenPipeError, ConnectionResetError):
            pass  # refused before all of it was sent: the answer may be there already
        reply = connection.getresponse()
        return reply.status, {k.lower(): v for k, v in reply.getheaders()}, reply.read()
    except (http.client.BadStatusLine, ConnectionError):
        return 0, {}, b""
    finally:
        connection.close()


def raw(address, data, read=True):
    """Sends bytes as they are; what comes back until the other side closes, at most a second."""
    host, port = address.rsplit(":", 1)
    with socket.create_connection((host, int(port)), timeout=PATIENCE_S) as connection:
        received = b""
        try:
            connection.sendall(data)
            connection.settimeout(1)
            while read and (part := connection.recv(65536)):
                received += part
        except (TimeoutError, ConnectionError):
            pass
        return received


# -- the attacks ------------------------------------------------------------------------------------------------------

TUNING = "orbitune.v1.TuningService"
SMALL = {"scenario": "scenarios/leo-rendezvous", "hyperparameters": {"iterations": 1}}


def bases(methods, canary):
    """A request of each method that is right as it stands and harms nothing."""
    own = {
        "CreateJob": {"job": SMALL},
        "CreateCampaign": {"campaign": {**SMALL, "initial_conditions": {"draw": {"count": 1}}}},
        "SimulateEpisode": {"scenario": "scenarios/leo-rendezvous"},
        "QueryGains": {"scenario": "scenarios/leo-rendezvous", "max_candidates": 1},
        "GetScenario": {"name": "scenarios/gto-geo"},
    }
    for method, descriptor in methods.items():
        fields = own.get(descriptor.name, {})
        for name in ("name", "parent"):
            if not fields and name in descriptor.input_type.fields_by_name:
                fields = {name: canary}
        yield method, {k: v for k, v in fields.items() if k in descriptor.input_type.fields_by_name}


def is_map(field):
    return field.message_type is not None and field.message_type.GetOptions().map_entry


def string_sites(descriptor, depth=0):
    """A function for each string in a message of this type, nested ones too, that sets it."""
    if depth > 5:
        return
    for field in descriptor.fields:
        repeated = field.label == FieldDescriptor.LABEL_REPEATED
        if field.type == FieldDescriptor.TYPE_STRING:
            def put(message, payload, field=field, repeated=repeated):
                if repeated:
                    getattr(message, field.name).append(payload)
                else:
                    setattr(message, field.name, payload)
            yield field.full_name, put
        elif is_map(field):
            if field.message_type.fields_by_name["value"].type == FieldDescriptor.TYPE_STRING:
                for key in (True, False):
                    yield field.full_name, lambda message, payload, field=field, key=key: getattr(
                        message, field.name).update({payload if key else "key": "value" if key else payload})
        elif field.message_type is not None and not field.message_type.full_name.startswith("google."):
            for name, put in string_sites(field.message_type, depth + 1):
                def put_nested(message, payload, field=field, repeated=repeated, put=put):
                    inner = getattr(message, field.name)
                    put(inner.add() if repeated else inner, payload)
                yield name, put_nested


def strings(server, api, canary):
    """SQL, line ends, paths, odd characters in every string of every request."""
    sites = calls = 0
    for method, base in bases(api.methods, canary):
        for name, put in string_sites(api.methods[method].input_type):
            sites += 1
            for payload in PAYLOADS + ["x" * 100_000]:
                request = api.request(method, base)
                put(request, payload)
                code, details, answer = api.send(method, request.SerializeToString())
                calls += 1
                assert code in CLEAN, f"{method}, {name} = {payload[:40]!r}: {code} {details}"
                if code == grpc.StatusCode.OK and answer is not None and name == "orbitune.v1.Job.display_name":
                    shown = answer.display_name
                    assert shown == payload, f"{name}: {shown!r} instead of {payload!r}"
    assert sites >= 60, sites
    return f"{sites} fields, {calls} calls"


def malformed_messages(server, api, canary):
    """Bytes that are no message, and texts that are no UTF-8: refused by gRPC or by us."""
    generator = random.Random(1)
    junk = [b"\xff" * 20, b"\x0a\x05\xff\xfe\xfd\xfc\xfb", b"\x0a\xff\xff\xff\xff\x0f", b"\x08" * 50, b"\x0b" * 5000,
            b"\x12\x80\x80\x80\x80\x80\x80\x80\x80\x80\x80\x01"]
    junk += [generator.randbytes(generator.randrange(1, 200)) for _ in range(30)]
    # A message within a message, ten thousand deep.
    warnings.simplefilter("error", RuntimeWarning)  # python's parser only warns of half of what is wrong
    nested = b""
    for _ in range(10_000):
        nested = b"\x0a" + varint(len(nested)) + nested
    junk.append(nested)
    for method in api.methods:
        if method.endswith((".DeleteJob", ".CreateCampaign")):
            continue  # junk may spell a name, or a campaign of thousands
        for data in junk:
            code, details, _ = api.send(method, data)
            assert code in CLEAN | UNREADABLE, f"{method}: {code} {details}"
            if code in UNREADABLE:
                try:
                    api.factory.GetPrototype(api.methods[method].input_type).FromString(data)
                except Exception:
                    continue
                raise AssertionError(f"{method}: {code} for a message that parses: {data[:50]!r} {details}")
    return f"{len(junk)} inputs for each method"


def varint(value):
    out = b""
    while True:
        out += bytes([value & 0x7f | (0x80 if value > 0x7f else 0)])
        value >>= 7
        if not value:
            return out


def oversized(server, api, canary):
    """A request of 17 MiB, 1,000 headers, a header of a megabyte, a filter and a map without end."""
    code, _, _ = api.call(f"{TUNING}.CreateJob", {"job": {**SMALL, "display_name": "x" * (17 * MIB)}})
    assert code == grpc.StatusCode.RESOURCE_EXHAUSTED, code
    labels = {f"key{i}": "v" * 100 for i in range(5_000)}
    code, _, _ = api.call(f"{TUNING}.CreateJob", {"job": {**SMALL, "labels": labels}})
    assert code == grpc.StatusCode.INVALID_ARGUMENT, code
    code, _, _ = api.call(f"{TUNING}.ListJobs", {"filter": " AND ".join(['labels.a = "b"'] * 100_000)})
    assert code in CLEAN - {grpc.StatusCode.OK}, code
    metadata = [(f"x-header-{i}", "v" * 50) for i in range(1000)]
    code, _, _ = api.call(f"{TUNING}.ListJobs", {}, metadata=metadata)
    assert code in ENDED, code
    code, _, _ = api.call(f"{TUNING}.ListJobs", {}, metadata=[("x-large", "v" * MIB)])
    assert code in ENDED, code
    code, _, _ = http_request(server, "GET", "/healthz", headers={f"X-Header-{i}": "v" for i in range(99)} | {"X-Last": "v" * 60_000})
    assert code == 431, code
    head = b"POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    assert b" 413 " in raw(server.http, head + b"Content-Length: 1073741824\r\n\r\n").split(b"\r\n")[0]
    # Chunks without end, until the server has had enough.
    host, port = server.http.rsplit(":", 1)
    with socket.create_connection((host, int(port)), timeout=PATIENCE_S) as connection:
        connection.sendall(head + b"Transfer-Encoding: chunked\r\n\r\n")
        deadline = time.monotonic() + PATIENCE_S
        try:
            while time.monotonic() < deadline:
                connection.sendall(b"100000\r\n" + b" " * MIB + b"\r\n")
            raise AssertionError("it takes chunks without end")
        except ConnectionError:
            pass


def decompression_bombs(server, api, canary):
    """A gRPC message and an HTTP body that grow by a factor of a thousand."""
    before = server.memory_mib("VmHWM")
    code, _, _ = api.send(f"{TUNING}.CreateJob", b"x" * (100 * MIB), compression=grpc.Compression.Gzip)
    assert code in (grpc.StatusCode.RESOURCE_EXHAUSTED, grpc.StatusCode.UNIMPLEMENTED), code
    packed = gzip.compress(b"[" * (100 * MIB), 1)
    code, _, body = http_request(server, "POST", "/v1/jobs", packed,
                                 {"Content-Type": "application/json", "Content-Encoding": "gzip"})
    assert code == 415, (code, body)
    grown = server.memory_mib("VmHWM") - before
    assert grown < 50 * memory_factor(server), f"{grown} MiB for a bomb"
    return f"peak {grown:.0f} MiB higher"


def deep_json(server, api, canary):
    """Nesting without end, in every way that JSON has, at every level of the message."""
    depth = 100_000
    deep = [b"[" * depth, b'{"a":' * depth, b'{"job":' * depth, b"[{" * depth, b'{"labels":' * depth,
            b'{"scenario_definition":{"target":' * depth + b"1" + b"}}" * depth,
            b'{"labels":{"a":' + b"[" * depth + b"]" * depth + b"}}"]
    for target in ("/v1/jobs", "/v1/campaigns", "/v1/gains:query", "/v1/gainSets:import", "/v1/episodes:simulate"):
        for body in deep:
            code, _, answer = http_request(server, "POST", target, body, {"Content-Type": "application/json"})
            assert code == 400, (target, body[:30], code, answer[:200])
            assert len(answer) < 100_000, f"{target}: {len(answer)} bytes of complaint"


def invalid_text(server, api, canary):
    """What is no UTF-8, over HTTP: in the path, the query, the body."""
    bad = ["%ff", "%c0%80", "%ed%a0%80", "%f4%90%80%80", "%c3", "%00"]
    for text in bad:
        for target in (f"/v1/jobs/{text}", f"/v1/jobs?filter={text}", f"/v1/jobs/x:watch?resume_after_seq={text}", f"/{text}"):
            code, _, _ = http_request(server, "GET", target)
            assert code in (400, 404), (target, code)
        body = b'{"display_name":"' + urllib.parse.unquote_to_bytes(text) + b'"}'
        code, _, answer = http_request(server, "POST", "/v1/jobs", body, {"Content-Type": "application/json"})
        assert code == 400, (body, code, answer)


def traversal(server, api, canary):
    """Paths out of every folder and collection."""
    steps = ["../", "..%2f", "%2e%2e/", "%2e%2e%2f", "..%5c", "....//", "%252e%252e%252f", "..;/", ".%00./"]
    for step in steps:
        for target in ("/{}etc/passwd", "/assets/{}etc/passwd", "/v1/jobs/{}etc/passwd", "/v1/{}etc/passwd",
                       "/v1/jobs/x/{}iterations", "/{}orbitune.db"):
            code, _, body = http_request(server, "GET", target.format(step * 8), headers={"Accept": "text/html"})
            assert code in (400, 404), (target, step, code)
            assert b"root:" not in body and b"SQLite format" not in body


def header_injection(server, api, canary):
    """Line ends in whatever might come back in a header."""
    for text in ("%0d%0aX-Injected:%20yes", "%0aX-Injected:yes", "%0dX-Injected:yes", "%E5%98%8D%E5%98%8AX-Injected:yes"):
        for target in (f"/{text}", f"/v1/jobs/{text}", f"/v1/jobs?page_token={text}", f"/v1/jobs/x:{text}", f"/v1/{text}/x"):
            for method in ("GET", "OPTIONS", "PUT", "POST"):
                _, headers, _ = http_request(server, method, target, b"" if method != "GET" else None)
                assert "x-injected" not in headers, (method, target, headers)
    # A bare CR or LF within a header's value, and headers that split a request in two.
    for value in (b"a\rX-Injected: yes", b"a\nX-Injected: yes", b"\x0b", b"a\0b"):
        answer = raw(server.http, b"GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nOrigin: " + value + b"\r\n\r\n")
        assert b"\r\nx-injected" not in answer.lower() and answer.startswith(b"HTTP/1.1 "), answer
    for event in ("1\r\n", "x" * 10_000, "-2", "1e3", "9" * 30, "'; DROP TABLE jobs; --"):
        headers = {"Accept": "text/event-stream", "Last-Event-ID": event.replace("\r\n", "")}
        code, _, _ = http_request(server, "GET", f"/v1/{canary}:watch", headers=headers)
        assert code in (200, 204, 400), (event, code)


def replays(server, api, canary):
    """The same request again: once more, with another payload, and fifty times at once."""
    body = {"job": {**SMALL, "display_name": "once"}, "request_id": "attack-replay"}
    with concurrent.futures.ThreadPoolExecutor(16) as pool:
        answers = list(pool.map(lambda _: api.call(f"{TUNING}.CreateJob", body), range(50)))
    assert {code for code, _, _ in answers} == {grpc.StatusCode.OK}, answers
    assert len({answer.name for _, _, answer in answers}) == 1
    body["job"]["display_name"] = "twice"
    code, _, _ = api.call(f"{TUNING}.CreateJob", body)
    assert code == grpc.StatusCode.ALREADY_EXISTS, code
    name = answers[0][2].name
    until(lambda: api.call(f"{TUNING}.GetJob", {"name": name})[2].state >= 4)  # SUCCEEDED or another end
    for _ in range(2):  # an etag of old
        code, _, _ = api.call(f"{TUNING}.DeleteJob", {"name": name, "etag": answers[0][2].etag})
        assert code == grpc.StatusCode.ABORTED, code


def credentials(server, api, canary):
    """Tokens, cookies and request ids that are none; a log-in with anything but a token."""
    values = ["Bearer", "Bearer " + "x" * 5000, "Bearer orb_" + "a" * 8 + "_" + "a" * 52, "Basic dXNlcjpwYXNz", "'; DROP TABLE tokens; --",
              "=; =; orbitune_session", "orbitune_session=" + "a" * 5000, ";" * 1000, "orbitune_session=../../x; __Host-orbitune_session=y"]
    for value in values:
        for name in ("Authorization", "Cookie", "X-Request-Id"):
            code, _, body = http_request(server, "GET", "/v1/jobs?page_size=1", headers={name: value})
            assert code in (200, 401, 429), (name, value[:50], code)
            assert value[:30].encode() not in body, "a credential is told back"
            code, _, _ = api.call(f"{TUNING}.ListJobs", {"page_size": 1}, metadata=[(name.lower(), value)])
            assert code in CLEAN, (name, value[:50], code)
    for body in (b"", b"{}", b"[]", b'{"token":1}', b'{"token":{}}', b'{"token":"' + b"x" * 100_000 + b'"}', b'{"token":"a\\u0000b"}',
                 b'{"token":"\xff"}', b'{"token":"' + b"\\u0027; DROP TABLE tokens; --" + b'"}', b"{" * 10_000):
        code, headers, _ = http_request(server, "POST", "/v1/session", body, {"Content-Type": "application/json"})
        # 200: where there are no tokens, everybody is somebody without one.
        assert (code == 200 or 400 <= code < 500) and "set-cookie" not in headers, (body[:50], code, headers)


def broken_http2(server, api, canary):
    """Frames that HTTP/2 does not have, or not there; streams opened and reset by the thousand."""
    preface = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"
    settings = frame(4, 0, 0, b"")
    generator = random.Random(2)
    hostile = [
        b"GET / HTTP/1.1\r\n\r\n", b"\x16\x03\x01\x02\x00\x01\x00", preface[:10], preface + b"\xff" * 5000,
        preface + settings + frame(1, 4, 0, b""),  # HEADERS on stream 0
        preface + settings + frame(0, 0, 1, b"x" * 100),  # DATA on a stream that is not open
        preface + settings + frame(1, 0, 1, headers()) + frame(9, 0, 1, b"") * 5000,  # CONTINUATION without end
        preface + settings + frame(8, 0, 0, b"\x7f\xff\xff\xff") * 3,  # windows beyond the largest
        preface + settings + frame(6, 0, 0, b"12345678") * 2000,  # PING
        preface + frame(4, 0, 0, b"\x00\x03\x00\x00\x00\x01") * 2000,  # SETTINGS
        preface + settings + struct.pack(">I", 0xffffff00)[:3] + b"\0\0\0\0\0\1",  # a frame of 16 MiB
        preface + settings + generator.randbytes(20_000)]
    with concurrent.futures.ThreadPoolExecutor(len(hostile)) as pool:
        list(pool.map(lambda data: raw(server.grpc, data), hostile))
    resets = b"".join(frame(1, 5, stream, headers()) + frame(3, 0, stream, b"\0\0\0\x08") for stream in range(1, 4001, 2))
    raw(server.grpc, preface + settings + resets)


def frame(kind, flags, stream, payload):
    return struct.pack(">I", len(payload))[1:] + bytes([kind, flags]) + struct.pack(">I", stream) + payload


def headers():
    """A request's head in HPACK without compression."""
    def literal(name, value):
        return b"\x00" + bytes([len(name)]) + name + bytes([len(value)]) + value
    return (literal(b":method", b"POST") + literal(b":scheme", b"http") + literal(b":authority", b"localhost") +
            literal(b":path", b"/orbitune.v1.TuningService/ListJobs") + literal(b"content-type", b"application/grpc") +
            literal(b"te", b"trailers"))


def slow_clients(server, api, canary):
    """Three hundred who never end their request, on both ports: everybody else is served as before."""
    half = []
    try:
        for i in range(300):
            address = server.http if i % 2 else server.grpc
            host, port = address.rsplit(":", 1)
            connection = socket.create_connection((host, int(port)), timeout=PATIENCE_S)
            connection.sendall(b"POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
                               b"Content-Length: 100000\r\n\r\n{" if i % 4 == 1
                               else b"GET / HTTP/1.1\r\nX-A: " if i % 2 else b"PRI * HTTP/2.0\r\n")
            half.append(connection)
        for _ in range(20):
            assert http_request(server, "GET", "/healthz")[0] == 200
            assert api.call(f"{TUNING}.GetJob", {"name": canary})[0] == grpc.StatusCode.OK
    finally:
        for connection in half:
            connection.close()


ATTACKS = [strings, malformed_messages, oversized, decompression_bombs, deep_json, invalid_text, traversal,
           header_injection, replays, credentials,
           broken_http2, slow_clients]


def memory_factor(server):
    """Sanitizers keep freed memory for a while, and a shadow of it all."""
    maps = pathlib.Path(f"/proc/{server.process.pid}/maps").read_text()
    return 10 if "libasan" in maps else 1


def stored(api, canary):
    """What must not change: the job, its history."""
    job = api.call(f"{TUNING}.GetJob", {"name": canary})[2]
    history = api.call(f"{TUNING}.ListIterations", {"parent": canary})[2]
    assert job is not None and history is not None
    return job.SerializeToString(deterministic=True), history.SerializeToString(deterministic=True)


def tables(server):
    with sqlite3.connect(f"file:{server.data}/orbitune.db?mode=ro", uri=True) as database:
        assert database.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        return database.execute("SELECT name, sql FROM sqlite_master ORDER BY name").fetchall()


def all_jobs_end(api):
    """What the attacks have made is flown to its end, so that memory can be compared."""
    code, _, answer = api.call(f"{TUNING}.ListJobs", {"filter": "state = RUNNING", "page_size": 1})
    return code == grpc.StatusCode.OK and not answer.jobs


def main():
    binary, repository, *chosen = sys.argv[1:]
    with tempfile.TemporaryDirectory() as directory:
        server = Server(binary, directory)
        try:
            api = Api(repository, directory, server.grpc)
            until(lambda: api.call(f"{TUNING}.ListJobs", {})[0] == grpc.StatusCode.OK)
            code, details, job = api.call(f"{TUNING}.CreateJob", {"job": {**SMALL, "display_name": "canary"}})
            assert code == grpc.StatusCode.OK, details
            until(lambda: api.call(f"{TUNING}.GetJob", {"name": job.name})[2].state >= 4)
            before, schema = stored(api, job.name), tables(server)
            resident = server.memory_mib("VmRSS")
            for attack in [attack for attack in ATTACKS if not chosen or attack.__name__ in chosen]:
                begin = time.monotonic()
                told = attack(server, api, job.name)
                assert server.process.poll() is None, f"{attack.__name__} has ended the server:\n{server.text()[-3000:]}"
                print(f"{attack.__name__}: {time.monotonic() - begin:.1f} s, {server.memory_mib('VmRSS'):.0f} MiB"
                      f"{', ' + told if told else ''}", flush=True)
            until(lambda: all_jobs_end(api))
            assert http_request(server, "GET", "/readyz")[0] == 200
            assert stored(api, job.name) == before, "an attack has changed what was stored"
            assert tables(server) == schema, "an attack has changed the schema"
            grown = server.memory_mib("VmRSS") - resident
            assert grown < 150 * memory_factor(server), f"memory has grown by {grown} MiB"
            assert server.stop() == 0, server.text()[-3000:]
        except BaseException:
            print(server.text()[-5000:], file=sys.stderr)
            raise
        finally:
            server.process.kill()


if __name__ == "__main__":
    main()
