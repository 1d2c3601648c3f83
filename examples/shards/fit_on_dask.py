"""Fits the shards of large data on a Dask cluster: each worker sums up one shard, and `rsm merge` fits the sums.

    python3 fit_on_dask.py HOST:PORT FIT.toml MODEL.toml SHARD.csv ...

Workers read the shards from the paths that are given, so these must be on storage that every worker sees. The specification goes to the workers
with the task, and the sums come back as its result: a few kB for each shard. Workers need `distributed` and the command `rsm` of one version. The
environment variable RSM names another command. A shard whose worker is lost is done again by another worker. The model does not depend on which
worker does what, nor on the order of the shards.
"""

import os
import pathlib
import subprocess
import sys
import tempfile


def part_of(shard, program, name, specification):
    """On a worker: the sums of a shard, as the bytes of a part file."""
    import pathlib
    import subprocess
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        fit, part = pathlib.Path(folder, name), pathlib.Path(folder, "part.rsm")
        fit.write_bytes(specification)
        command = [program, "fit", str(fit), "--data", shard, "--partial", str(part)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise RuntimeError(done.stderr)
        return part.read_bytes()


def main():
    if len(sys.argv) < 5:
        print(__doc__, file=sys.stderr)
        return 2
    from distributed import Client, as_completed

    scheduler, specification, model, *shards = sys.argv[1:]
    specification = pathlib.Path(specification)
    program = os.environ.get("RSM", "rsm")
    with Client(scheduler, timeout=30) as client, tempfile.TemporaryDirectory() as folder:
        shards = [str(pathlib.Path(shard).resolve()) for shard in shards]
        text = specification.read_bytes()
        # The same shard may have other rows tomorrow: no result of an earlier run counts.
        tasks = client.map(part_of, shards, program=program, name=specification.name, specification=text, pure=False)
        parts = []
        for task, part in as_completed(tasks, with_results=True):
            parts.append(str(pathlib.Path(folder, f"{tasks.index(task)}.rsm")))
            pathlib.Path(parts[-1]).write_bytes(part)
        return subprocess.run([program, "merge", *parts, "--out", model], check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
