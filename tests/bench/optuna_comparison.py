#!/usr/bin/python3
"""Durable results per second, beside python3-optuna's SQLite storage: both on the same disk, in turns, in one run.

    tests/bench/optuna_comparison.py BUILD/bin [--directory DIR] [--rounds 3]

The unit is what each of them commits for one step of a search over five gains: of Optuna a trial (five parameters and
a value, from a random sampler, with an objective that costs nothing, so that the storage is what is measured); of
Orbitune an iteration (K, J and its terms, sigma_J, counts). Each is on disk before the next step counts:
  optuna     one trial after the other
  one by one the store alone, every iteration answered before the next is given to it
  grouped    the store alone, iterations given to it as they come; the writer commits them in groups
  server     orbituned at work on four jobs, the 2N + 1 episodes of each iteration flown: create to end
Needs python3-optuna (Debian: apt-get install python3-optuna), which nothing else does.
"""

import argparse
import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request

import optuna

TRIALS = 150
APPENDED = 100_000
JOBS = 4
ITERATIONS = 5000


def optuna_trials_per_s(directory):
    storage = f"sqlite:///{directory}/optuna.db"
    study = optuna.create_study(storage=storage, sampler=optuna.samplers.RandomSampler(seed=1))

    def objective(trial):
        return sum(trial.suggest_float(f"k{i}", 1e-3, 1e3, log=True) for i in range(1, 6))

    begin = time.monotonic()
    study.optimize(objective, n_trials=TRIALS)
    return TRIALS / (time.monotonic() - begin)


def appended_per_s(binaries, directory):
    out = subprocess.run([f"{binaries}/append_benchmark", directory, str(APPENDED), "1"], check=True,
                         capture_output=True, text=True).stdout
    microseconds = dict(re.findall(r"^(all at once|one at a time) .*: ([0-9.]+) us each", out, re.M))
    return 1e6 / float(microseconds["all at once"]), 1e6 / float(microseconds["one at a time"])


def seconds_of(timestamp):
    return time.mktime(time.strptime(timestamp[:19], "%Y-%m-%dT%H:%M:%S")) + float("0" + timestamp[19:].rstrip("Z"))


def server_iterations_per_s(binaries, directory):
    command = [f"{binaries}/orbituned", "--data-dir", f"{directory}/server", "--listen", "127.0.0.1:0", "--http",
               "127.0.0.1:0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as server:
        try:
            address = next(line.split()[1] for line in server.stdout if line.startswith("http "))

            def call(path, body=None):
                data = None if body is None else json.dumps(body).encode()
                request = urllib.request.Request(f"http://{address}/v1/{path}", data,
                                                 {"Content-Type": "application/json"})
                with urllib.request.urlopen(request) as reply:
                    return json.load(reply)

            jobs = [call("jobs", {"scenario": "scenarios/gto-geo",
                                  "hyperparameters": {"iterations": ITERATIONS, "seed": seed}})
                    for seed in range(JOBS)]
            while not all(job["state"].endswith(("SUCCEEDED", "FAILED")) for job in jobs):
                time.sleep(0.1)
                jobs = [call(job["name"]) for job in jobs]
            begin = min(seconds_of(job["create_time"]) for job in jobs)
            end = max(seconds_of(job["end_time"]) for job in jobs)
            return sum(job["completed_iterations"] for job in jobs) / (end - begin)
        finally:
            server.terminate()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("binaries", help="where append_benchmark and orbituned are")
    parser.add_argument("--directory", help="on the disk that is meant; a temporary one otherwise")
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    rates = {"optuna": [], "one by one": [], "grouped": [], "server": []}
    for _ in range(arguments.rounds):
        with tempfile.TemporaryDirectory(dir=arguments.directory) as directory:
            rates["optuna"].append(optuna_trials_per_s(directory))
            grouped, one_by_one = appended_per_s(arguments.binaries, directory)
            rates["one by one"].append(one_by_one)
            rates["grouped"].append(grouped)
            rates["server"].append(server_iterations_per_s(arguments.binaries, directory))
    print(f"optuna {optuna.__version__}, {os.cpu_count()} cores, the median of {arguments.rounds} rounds")
    trials = statistics.median(rates["optuna"])
    for name, values in rates.items():
        print(f"{name:11}{statistics.median(values):12.1f} /s   {statistics.median(values) / trials:9.1f} x"
              f"   ({min(values):.1f} to {max(values):.1f})")
    return 0


if __name__ == "__main__":
    sys.exit(main())
