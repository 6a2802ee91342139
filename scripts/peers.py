"""Measures one hop between two Python processes: plain means, Teseo's transport, and its peers.

Started by scripts/peers, in name spaces of its own. A hop is half a round trip: one process fills a
payload with a value that changes, sends it, and waits for an answer of the same size; who receives
reads every byte. Nothing that was measured is left out but the first few samples of each pair of
processes. In each round everything is measured once, so that all meet the same machine.
"""

import importlib.metadata
import json
import os
import platform
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from peer_links import WAYS, wait_until

SIZES = {
    "64 B": (64, 1000),
    "a scan": (3904, 1000),
    "64 KiB": (65_536, 500),
    "1 MiB": (1 << 20, 200),
}
"""[byte] How large a payload is (a scan of 960 beams, or half as many with intensities), [-] how many count
in a round."""

WARM_UP = 64
"""[-] Samples before the first that counts, as in `teseo bench`."""

PAIR_LASTS_MAX_S = 60
"""However long two processes take: by then something is wrong."""

FLOORS = {True: "flag", False: "unix socket"}
"""What others are told in multiples of: of those that look, and of those that sleep."""

TESEO = {
    True: ("flag", "iceoryx2 poll", "teseo poll"),
    False: ("unix socket", "iceoryx2 block", "teseo block"),
}
"""The rows of `teseo bench hop`, floor first."""

WAITS = {True: "who waits looks again and again", False: "who waits sleeps"}


def play(way: str, role: str, size: int, samples: int) -> None:
    """One of the two processes. Writes what it measured into its working directory."""
    asks = role == "asks"
    other = "answers" if asks else "asks"
    link = WAYS[way].open(asks, size)
    # As in `teseo bench`, each is on a core of its own; threads that its library has are where they like.
    cores = sorted(os.sched_getaffinity(0))
    os.sched_setaffinity(0, {cores[0] if asks else cores[-1]})
    Path(role).touch()
    wait_until(Path(other).exists)
    halves = []
    for number in range(WARM_UP + samples):
        value = 1 + number % 255
        begun = time.perf_counter_ns()
        if asks:
            link.send(value)
        if not link.receive(value):
            raise RuntimeError(f"sample {number} came damaged")
        if not asks:
            link.send(value)
        halves.append((time.perf_counter_ns() - begun) / 2)
    if asks:
        Path("halves").write_text(json.dumps(halves[WARM_UP:]))
    # Who leaves first may take with him what the other still reads.
    Path(role + " is done").touch()
    wait_until(Path(other + " is done").exists)


def commands(way: str, size: int, samples: int) -> list[list[str]]:
    """What is to be started, in an empty working directory."""
    script = str(Path(__file__).resolve())
    sides = {role: ["play", way, role, str(size), str(samples)] for role in ("asks", "answers")}
    if way != "dora":
        return [[sys.executable, script, *side] for side in sides.values()]
    inputs = {"asks": "answers", "answers": "asks"}
    nodes = [
        {
            "id": role,
            "path": sys.executable,
            "args": " ".join([script, *side]),
            "inputs": {"payload": f"{inputs[role]}/payload"},
            "outputs": ["payload"],
        }
        for role, side in sides.items()
    ]
    # JSON is YAML.
    Path("dataflow.yml").write_text(json.dumps({"nodes": nodes}))
    return [[dora_command() or "dora", "run", "dataflow.yml"]]


def dora_command() -> str | None:
    return shutil.which("dora", path=f"{Path(sys.executable).parent}:{os.environ['PATH']}")


def measure(way: str, size: int, samples: int) -> list[float]:
    """[ns] Starts two processes, and returns what the first measured."""
    started: list[subprocess.Popen[bytes]] = []
    with tempfile.TemporaryDirectory() as directory, tempfile.TemporaryFile() as said:
        os.chdir(directory)
        try:
            for command in commands(way, size, samples):
                started.append(
                    subprocess.Popen(command, stdout=said, stderr=said, start_new_session=True)
                )
            until = time.monotonic() + PAIR_LASTS_MAX_S
            codes = [process.wait(max(0.1, until - time.monotonic())) for process in started]
            if any(codes):
                raise RuntimeError(f"ended with {codes}")
            return list(json.loads(Path("halves").read_text()))
        except (OSError, RuntimeError, subprocess.TimeoutExpired) as cause:
            said.seek(0)
            lines = said.read().decode(errors="replace").strip().splitlines() or [""]
            raise RuntimeError(f"{cause}: {lines[-1]}") from cause
        finally:
            for process in started:
                if process.poll() is None:
                    os.killpg(process.pid, signal.SIGKILL)
                    process.wait()
            os.chdir("..")


def absence(way: str) -> str | None:
    """Why `way` cannot be measured here."""
    package = WAYS[way].package
    try:
        if package is not None:
            importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return f"Python package {package} is not installed"
    if way == "dora" and dora_command() is None:
        return "there is no command dora (Python package dora-rs-cli)"
    return None


def quantile(ordered: list[float], share: float) -> float:
    """The smallest value that at least `share` of all do not exceed."""
    return ordered[max(0, -(-len(ordered) * int(1000 * share) // 1000) - 1)]


def summary(rounds: list[list[float]]) -> dict[str, float]:
    ordered = sorted(value for values in rounds for value in values)
    shares = {"p50": 0.5, "p90": 0.9, "p99": 0.99, "max": 1.0}
    return {name: quantile(ordered, share) for name, share in shares.items()} | {
        "count": len(ordered)
    }


def head(size: str, looks: bool) -> None:
    columns = f"{'p50':>9}{'p90':>9}{'p99':>9}{'max':>9}{'count':>7}"
    print(f"\n{size + '; ' + WAITS[looks]:<44}{columns}   p50 of rounds  over floor")


def row(name: str, figure: dict[str, float], medians: list[float], floor: float | None) -> None:
    """One line of a table; everything but the count in nanoseconds."""
    values = "".join(f"{figure[key] / 1e3:>9.1f}" for key in ("p50", "p90", "p99", "max"))
    span = f"{min(medians) / 1e3:.1f}..{max(medians) / 1e3:.1f}"
    ratio = f"{figure['p50'] / floor:>12.2f}" if floor else ""
    print(f"  {name:<42}{values}{figure['count']:>7.0f}{span:>16}{ratio}")


def python_rows(rounds: int) -> None:
    """Measures and prints what is between two Python processes."""
    absent = {way: reason for way in WAYS if (reason := absence(way))}
    measured: dict[tuple[str, str], list[list[float]]] = {}
    for number in range(rounds):
        for way in [way for way in WAYS if way not in absent]:
            print(f"round {number + 1} of {rounds}: {way}", file=sys.stderr)
            for size, (length, samples) in SIZES.items():
                try:
                    values = measure(way, length, samples)
                    measured.setdefault((way, size), []).append(values)
                except RuntimeError as cause:
                    absent[f"{way}, {size}, round {number + 1}"] = str(cause)
    print(f"\nPYTHON {platform.python_version()} ON BOTH SIDES: half a round trip in us")
    print("The floors are the flag of those that look, and the Unix socket of those that sleep.")
    print("All fill by memset and read by memcmp, and are compared with their binding to Python:")
    for way, (_, _, package, note) in WAYS.items():
        version = importlib.metadata.version(package) if package and way not in absent else ""
        print(f"  {way + ' ' + version:<31}{note}")
    for looks, floor in FLOORS.items():
        for size in SIZES:
            head(size, looks)
            ways = [way for way in WAYS if WAYS[way].looks == looks and (way, size) in measured]
            figures = {way: summary(measured[way, size]) for way in ways}
            for way, figure in figures.items():
                medians = [summary([values])["p50"] for values in measured[way, size]]
                row(way, figure, medians, figures.get(floor, {}).get("p50"))
    for way, reason in absent.items():
        print(f"\nnot measured: {way}: {reason}")


def rust_rows(teseo: str) -> None:
    """Lets `teseo bench` measure, and prints its rows of the same sizes."""
    print("\nRUST ON BOTH SIDES: these fill and read word by word, and are not to be compared")
    print("with the Python rows but through the floors of each")
    command = [teseo, "bench", "hop", "--quick", "--only", "across cores, back to back", "--json"]
    try:
        run = subprocess.run(command, check=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    except (OSError, subprocess.CalledProcessError) as cause:
        print(f"  not measured: {cause}")
        return
    report = json.loads(run.stdout)
    card = report["card"]
    print(f"  teseo {card['teseo']}; iceoryx2 {card['iceoryx2']}; in us")
    print(f"  `--quick`: a look; others took {card['foreign']:.0%} of the processors meanwhile")
    figures = {figure["name"]: figure for figure in report["figures"]}
    for looks, ways in TESEO.items():
        for size in SIZES:
            head(size, looks)
            names = [f"{way}, {size}, across cores, back to back" for way in ways]
            floor = figures[names[0]]["p50"]
            for way, name in zip(ways, names, strict=True):
                medians = [values["value"] for values in figures[name]["rounds"]]
                row(way, figures[name], medians, floor)


def load() -> str:
    return " ".join(f"{load:.2f}" for load in os.getloadavg())


def processor() -> str:
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    return next((line.split(": ")[1] for line in lines if line.startswith("model name")), "unknown")


def main() -> None:
    if sys.argv[1] == "play":
        way, role, size, samples = sys.argv[2:]
        play(way, role, int(size), int(samples))
        return
    rounds, teseo = int(sys.argv[1]), sys.argv[2]
    print(f"processor     {processor()}, {os.cpu_count()} cores; kernel {platform.release()}")
    print(f"load before   {load()}", flush=True)
    python_rows(rounds)
    rust_rows(teseo)
    print(f"\nload after    {load()}")


if __name__ == "__main__":
    main()
