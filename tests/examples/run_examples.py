#!/usr/bin/python3
"""Runs the examples of README.md and docs/api.md as they stand, with clients that nobody here wrote.

    run_examples.py ORBITUNED REPOSITORY

Starts a server of its own on free ports, puts its addresses where an example has the default ones, and runs:
the curl examples (each must succeed), the Python example over python3-grpcio (it must print what the page says), the one
that recomputes digests (for every job), and `buf curl` where tests/buf has installed buf. Exit status: 0, or 1 with what went wrong.
"""

import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile

GOOGLEAPIS = "/usr/share/gocode/src/github.com/grpc-ecosystem/grpc-gateway/third_party/googleapis"


def section(page, heading):
    """The text under a heading of any level, up to the next one."""
    found = re.search(rf"^#+ {re.escape(heading)}\n(.*?)(?=^#+ |\Z)", page, re.MULTILINE | re.DOTALL)
    assert found, f"no section {heading!r}"
    return found.group(1)


def blocks(text, language):
    """The fenced blocks of a language ("" for those without one)."""
    return [body for lang, body in re.findall(r"^```(\w*)\n(.*?)^```", text, re.MULTILINE | re.DOTALL) if lang == language]


class Server:
    """An orbituned on free ports; stopped at the end of a with statement."""

    def __init__(self, binary, directory):
        environment = {k: v for k, v in os.environ.items() if not k.startswith("ORBITUNE_")}
        self.process = subprocess.Popen(
            [binary, "--data-dir", f"{directory}/data", "--listen", "127.0.0.1:0", "--http", "127.0.0.1:0"],
            stdout=subprocess.PIPE, text=True, env=environment)
        lines = {}
        while "threads" not in lines:
            line = self.process.stdout.readline()
            assert line, "the server did not start"
            key, _, value = line.strip().partition(" ")
            lines[key] = value
        self.grpc, self.http = lines["grpc"], lines["http"]

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.terminate()
        assert self.process.wait(timeout=60) == 0, "the server did not stop well"

    def here(self, text):
        """An example with this server's addresses in place of the default ones."""
        return text.replace("127.0.0.1:7313", self.grpc).replace("127.0.0.1:7314", self.http)


def run(command, directory, **options):
    done = subprocess.run(command, cwd=directory, capture_output=True, text=True, timeout=300, **options)
    if done.returncode != 0:
        print(f"{command}\n{done.stdout}{done.stderr}\nexit status {done.returncode}", file=sys.stderr)
        sys.exit(1)
    return done.stdout


def run_curl(server, text, directory):
    """Each shell block in a shell of its own that stops at the first failure; an HTTP error is one."""
    pathlib.Path(directory, ".curlrc").write_text("fail-with-body\nsilent\nshow-error\n")
    examples = blocks(text, "sh")
    assert examples and all("curl" in example for example in examples), "the curl examples are gone"
    return [run(["bash", "-euo", "pipefail", "-c", server.here(example)], directory,
                env={**os.environ, "HOME": directory}) for example in examples]


def run_python(server, text, repository, directory):
    stubs = f"{directory}/stubs"
    os.mkdir(stubs)
    protos = [str(p.relative_to(f"{repository}/proto")) for p in pathlib.Path(repository, "proto/orbitune").rglob("*.proto")]
    run(["protoc", f"-I{repository}/proto", f"-I{GOOGLEAPIS}", f"--python_out={stubs}", f"--grpc_out={stubs}",
         "--plugin=protoc-gen-grpc=/usr/bin/grpc_python_plugin", *protos, "google/api/annotations.proto",
         "google/api/http.proto"], directory)
    (example,) = blocks(text, "python")
    (expected,) = blocks(text, "")
    printed = run(["/usr/bin/python3", "-c", server.here(example)], directory, env={**os.environ, "PYTHONPATH": stubs})
    assert printed == expected, f"printed\n{printed}not\n{expected}"


ROBUST_JOB = """{"scenario": "scenarios/leo-rendezvous", "hyperparameters": {"iterations": 4, "algorithm": "ALGORITHM_CMA_ES"},
  "objective": {"aggregate": "AGGREGATE_CVAR", "level": 0.5}, "initial_conditions": [
    {"keplerian": {"semi_major_axis_km": 6978, "eccentricity": 0.001, "inclination_deg": 51.6, "raan_deg": -0.0}},
    {"equinoctial": {"p_km": 6990.123, "ex": 0.001, "hx": 0.48}}]}"""


def run_digest(server, text, directory):
    """For every job there is, and for one that has what these have not."""
    (example,) = blocks(text, "python")
    url = f"http://{server.http}/v1/jobs"
    created = json.loads(run(["curl", "--json", ROBUST_JOB, url], directory, env={**os.environ, "HOME": directory}))
    run(["curl", "-N", f"{url[:-4]}{created['name']}:watch"], directory, env={**os.environ, "HOME": directory})
    jobs = json.loads(run(["curl", url], directory, env={**os.environ, "HOME": directory}))["jobs"]
    assert created["name"] in [job["name"] for job in jobs] and len(jobs) > 1
    for job in jobs:
        printed = run(["/usr/bin/python3", "-c", server.here(example), job["name"]], directory)
        if job["state"] == "JOB_STATE_SUCCEEDED":
            assert printed.split() == [job["name"], job["provenance"]["digest"]], printed


def run_buf(server, repository, directory):
    buf = pathlib.Path(repository, "tests/buf/node_modules/@bufbuild/buf-linux-x64/bin/buf")
    if not buf.exists():
        print("buf curl: left out, buf is not installed (tests/buf/check installs it)")
        return
    answer = run([str(buf), "curl", "--protocol", "grpc", "--http2-prior-knowledge", "-d", '{"name":"scenarios/gto-geo"}',
                  f"http://{server.grpc}/orbitune.v1.ScenarioService/GetScenario"], directory)
    assert '"scenarios/gto-geo"' in answer, answer


def main():
    binary, repository = sys.argv[1:]
    readme = pathlib.Path(repository, "README.md").read_text()
    api = pathlib.Path(repository, "docs/api.md").read_text()
    with tempfile.TemporaryDirectory() as directory, Server(binary, directory) as server:
        for output in run_curl(server, section(readme, "With curl") + section(api, "With curl"), directory):
            assert output.strip(), "an example printed nothing"
        run_python(server, section(api, "From Python"), repository, directory)
        run_digest(server, section(api, "Proof of results"), directory)
        run_buf(server, repository, directory)


if __name__ == "__main__":
    main()
