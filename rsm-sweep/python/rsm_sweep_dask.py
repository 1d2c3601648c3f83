"""Runs the tasks of `rsm sweep` on a Dask cluster: `rsm sweep --engine dask` starts it as `python3 -m rsm_sweep_dask HOST:PORT`.

In, on standard input: one JSON object with `program` (the command `rsm` on the workers), `bundle` (the scenario with all its files, as text) and
`tasks` (hashes). Out, on standard output: a JSON line for each task, `{"task", "result"}` with the bytes that the worker printed, or `{"task", "error"}`.
Exit status 0: every task has a line.

No file system is shared: the bundle goes to the workers through Dask, and results come back through it. The workers need `distributed` and
the command `rsm` of the same version, not this module: its functions are sent by value.
"""

import json
import sys
import zlib

# Tasks that the scheduler holds at a time: enough for every thread of a large cluster, and not the memory of a million.
WINDOW = 5000

# How often a task is begun again when its worker died with it.
RETRIES = 5


def unpacked(packed):
    """The bundle on a worker. It is a task itself, so that Dask makes it again when the worker that holds it is gone."""
    return packed


def run_task(program, packed, task):
    """Runs one task on a worker: the status of `rsm`, what it printed, and what it said."""
    import hashlib
    import os
    import subprocess
    import tempfile
    import zlib

    name = hashlib.sha256(packed).hexdigest()[:32]
    path = os.path.join(tempfile.gettempdir(), f"rsm-sweep-{os.getuid() if hasattr(os, 'getuid') else 0}-{name}.json")
    if not os.path.exists(path):
        # Whole or absent: several tasks may begin here at the same time.
        handle, part = tempfile.mkstemp(prefix="rsm-sweep-", suffix=".part")
        with os.fdopen(handle, "wb") as file:
            file.write(zlib.decompress(packed))
        os.replace(part, path)
    done = subprocess.run([program, "sweep", path, "--task", task], capture_output=True, check=False)
    return done.returncode, done.stdout.decode(), done.stderr.decode()


def tell(task, **what):
    print(json.dumps({"task": task, **what}), flush=True)


def main():
    if len(sys.argv) != 2:
        print("usage: python3 -m rsm_sweep_dask HOST:PORT < job.json", file=sys.stderr)
        return 2
    try:
        import cloudpickle
        from distributed import Client, as_completed
    except ImportError as error:
        print(f"rsm_sweep_dask: {error}: pip install distributed", file=sys.stderr)
        return 2
    cloudpickle.register_pickle_by_value(sys.modules[__name__])
    job = json.load(sys.stdin)
    packed = zlib.compress(job["bundle"].encode())
    tasks = job["tasks"]
    try:
        client = Client(f"tcp://{sys.argv[1]}", timeout=10, set_as_default=False)
    except OSError as error:
        print(f"rsm_sweep_dask: no scheduler at {sys.argv[1]}: {error}", file=sys.stderr)
        return 2
    with client:
        bundle = client.submit(unpacked, packed, pure=False, retries=RETRIES)
        hashes = {}

        def begin(task):
            future = client.submit(run_task, job["program"], bundle, task, pure=False, retries=RETRIES)
            hashes[future.key] = task
            return future

        running = as_completed([begin(task) for task in tasks[:WINDOW]], loop=client.loop)
        waiting = iter(tasks[WINDOW:])
        for future in running:
            task = hashes.pop(future.key)
            if future.status == "finished":
                status, printed, said = future.result()
                # 1 is an answer: a simulation that stopped has a result, too.
                if status in (0, 1):
                    tell(task, result=printed)
                else:
                    tell(task, error=f"rsm ended with status {status}: {said.strip()}")
            else:
                tell(task, error=repr(future.exception() if future.status == "error" else future.status))
            future.release()
            following = next(waiting, None)
            if following is not None:
                running.add(begin(following))
    return 0


if __name__ == "__main__":
    sys.exit(main())
